"""skinbus: contacts from tactile skin patches on a CAN bus; CANopen in, CANopen out, no ROS."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skinbus.config.system import load_arm
    from skinbus.estimate import Baseline, Contacts, Estimator, Tracker, learn_radial_law
    from skinbus.master import Master
    from skinbus.model import Arm
    from skinbus.sim import load_scene

__version__ = "0.2.0"
__all__ = [
    "Arm",
    "Baseline",
    "Contacts",
    "Estimator",
    "Master",
    "Tracker",
    "learn_radial_law",
    "load_arm",
    "load_scene",
]

# Loaded at first use: numpy, scipy and numba take most of a second that `skinbus --help` does not have.
_HOME = {
    "Arm": "skinbus.model",
    "Baseline": "skinbus.estimate",
    "Contacts": "skinbus.estimate",
    "Estimator": "skinbus.estimate",
    "Master": "skinbus.master",
    "Tracker": "skinbus.estimate",
    "learn_radial_law": "skinbus.estimate",
    "load_arm": "skinbus.config.system",
    "load_scene": "skinbus.sim",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'skinbus' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
