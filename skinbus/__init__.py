"""skinbus: contacts from tactile skin patches on a CAN bus; CANopen in, CANopen out, no ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinbus.lazy import at_first_use

if TYPE_CHECKING:
    from skinbus.config.system import load_arm
    from skinbus.estimate import Baseline, Contacts, Estimator, Tracker, learn_radial_law
    from skinbus.master import Master
    from skinbus.model import Arm
    from skinbus.sim import load_scene
    from skinbus.skin.attached import attach
    from skinbus.skin.cycle import Cycle
    from skinbus.skin.listened import listen
    from skinbus.skin.opened import open
    from skinbus.skin.replayed import replay
    from skinbus.skin.simulated import simulate
    from skinbus.skin.skin import Skin

__version__ = "0.2.0"
__all__ = [
    "Arm",
    "Baseline",
    "Contacts",
    "Cycle",
    "Estimator",
    "Master",
    "Skin",
    "Tracker",
    "attach",
    "learn_radial_law",
    "listen",
    "load_arm",
    "load_scene",
    "open",
    "replay",
    "simulate",
]

# Loaded at first use: numpy, scipy and numba take most of a second that `skinbus --help` does not have.
_HOME = {
    "Arm": "skinbus.model",
    "Baseline": "skinbus.estimate",
    "Contacts": "skinbus.estimate",
    "Cycle": "skinbus.skin.cycle",
    "Estimator": "skinbus.estimate",
    "Master": "skinbus.master",
    "Skin": "skinbus.skin.skin",
    "Tracker": "skinbus.estimate",
    "attach": "skinbus.skin.attached",
    "learn_radial_law": "skinbus.estimate",
    "listen": "skinbus.skin.listened",
    "load_arm": "skinbus.config.system",
    "load_scene": "skinbus.sim",
    "open": "skinbus.skin.opened",
    "replay": "skinbus.skin.replayed",
    "simulate": "skinbus.skin.simulated",
}
__getattr__ = at_first_use(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
