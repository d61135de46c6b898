"""Pressures to contacts: pure functions on arrays, kernels compiled by numba."""

from skinbus.estimate.baseline import Baseline
from skinbus.estimate.budget import Clock, monotonic_clock
from skinbus.estimate.calibration import Calibration, learn_radial_law
from skinbus.estimate.contacts import DEFAULT_LEVEL, LEVELS, Contact, Contacts, Quality
from skinbus.estimate.estimator import Estimator
from skinbus.estimate.loads import LoadMeter, LoadRows, Loads
from skinbus.estimate.plausibility import Fault, Plausibility
from skinbus.estimate.tracking.tracker import Tracker, Tracks, TrackState, Unseen

__all__ = [
    "DEFAULT_LEVEL",
    "LEVELS",
    "Baseline",
    "Calibration",
    "Clock",
    "Contact",
    "Contacts",
    "Estimator",
    "Fault",
    "LoadMeter",
    "LoadRows",
    "Loads",
    "Plausibility",
    "Quality",
    "TrackState",
    "Tracker",
    "Tracks",
    "Unseen",
    "learn_radial_law",
    "monotonic_clock",
]
