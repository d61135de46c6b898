"""skinbus: contacts from tactile skin patches on a CAN bus; CANopen in, CANopen out, no ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinbus.errors import AddressError as AddressError
from skinbus.errors import ArgumentError as ArgumentError
from skinbus.errors import BusError as BusError
from skinbus.errors import ConfigError as ConfigError
from skinbus.errors import LocalProtocolError as LocalProtocolError
from skinbus.errors import MissingFileError as MissingFileError
from skinbus.errors import ProtocolError as ProtocolError
from skinbus.errors import RemoteProtocolError as RemoteProtocolError
from skinbus.errors import SdoAborted as SdoAborted
from skinbus.errors import ShareError as ShareError
from skinbus.errors import SkinbusError as SkinbusError
from skinbus.lazy import at_first_use

if TYPE_CHECKING:
    from skinbus.config.system import load_arm as load_arm
    from skinbus.estimate import Baseline as Baseline
    from skinbus.estimate import Contacts as Contacts
    from skinbus.estimate import Estimator as Estimator
    from skinbus.estimate import Tracker as Tracker
    from skinbus.estimate import learn_radial_law as learn_radial_law
    from skinbus.master import Master as Master
    from skinbus.model import Arm as Arm
    from skinbus.sim import load_scene as load_scene
    from skinbus.skin.attached import attach as attach
    from skinbus.skin.contact import Contact as Contact
    from skinbus.skin.cycle import Cycle as Cycle
    from skinbus.skin.cycle import Patch as Patch
    from skinbus.skin.cycle import Readings as Readings
    from skinbus.skin.listened import listen as listen
    from skinbus.skin.opened import open as open
    from skinbus.skin.replayed import replay as replay
    from skinbus.skin.simulated import simulate as simulate
    from skinbus.skin.skin import Skin as Skin

__version__ = "0.2.0"

# Loaded at first use: numpy, scipy and numba take most of a second that `skinbus --help` does not have.
_HOME = {
    name: f"skinbus.{module}"
    for module, names in {
        "config.system": "load_arm",
        "estimate": "Baseline Contacts Estimator Tracker learn_radial_law",
        "master": "Master",
        "model": "Arm",
        "sim": "load_scene",
        "skin.attached": "attach",
        "skin.contact": "Contact",
        "skin.cycle": "Cycle Patch Readings",
        "skin.listened": "listen",
        "skin.opened": "open",
        "skin.replayed": "replay",
        "skin.simulated": "simulate",
        "skin.skin": "Skin",
    }.items()
    for name in names.split()
}
__all__ = [
    *_HOME,
    *(name for name in globals() if name.endswith(("Error", "Aborted"))),
]
__getattr__ = at_first_use(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
