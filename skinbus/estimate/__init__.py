"""Pressures to contacts: pure functions on arrays, kernels compiled by numba."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinbus.lazy import at_first_use

if TYPE_CHECKING:
    from skinbus.estimate.baseline import Baseline
    from skinbus.estimate.budget import Clock, monotonic_clock
    from skinbus.estimate.calibration.learning import Calibration, learn_radial_law
    from skinbus.estimate.contacts import DEFAULT_LEVEL, LEVELS, Contact, Contacts, Quality
    from skinbus.estimate.estimator import Estimator
    from skinbus.estimate.loads import LoadMeter, LoadRows, Loads
    from skinbus.estimate.plausibility import Plausibility, TactelFault
    from skinbus.estimate.tracking import Tracker, Tracks, TrackState

__all__ = [
    "DEFAULT_LEVEL",
    "LEVELS",
    "Baseline",
    "Calibration",
    "Clock",
    "Contact",
    "Contacts",
    "Estimator",
    "LoadMeter",
    "LoadRows",
    "Loads",
    "Plausibility",
    "Quality",
    "TactelFault",
    "TrackState",
    "Tracker",
    "Tracks",
    "learn_radial_law",
    "monotonic_clock",
]

# Loaded at first use: a command that names a level does not pay for kernels and scipy.
_HOME = {
    "Baseline": "skinbus.estimate.baseline",
    "Calibration": "skinbus.estimate.calibration.learning",
    "Clock": "skinbus.estimate.budget",
    "Contact": "skinbus.estimate.contacts",
    "Contacts": "skinbus.estimate.contacts",
    "DEFAULT_LEVEL": "skinbus.estimate.contacts",
    "Estimator": "skinbus.estimate.estimator",
    "LEVELS": "skinbus.estimate.contacts",
    "LoadMeter": "skinbus.estimate.loads",
    "LoadRows": "skinbus.estimate.loads",
    "Loads": "skinbus.estimate.loads",
    "Plausibility": "skinbus.estimate.plausibility",
    "Quality": "skinbus.estimate.contacts",
    "TactelFault": "skinbus.estimate.plausibility",
    "TrackState": "skinbus.estimate.tracking",
    "Tracker": "skinbus.estimate.tracking",
    "Tracks": "skinbus.estimate.tracking",
    "learn_radial_law": "skinbus.estimate.calibration.learning",
    "monotonic_clock": "skinbus.estimate.budget",
}
__getattr__ = at_first_use(__name__, _HOME)
