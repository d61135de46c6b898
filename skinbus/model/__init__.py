"""Facts and exact maths: patches, surfaces, arms, contact laws, transducers. No I/O."""

from skinbus.model.arm import Arm, BusSettings, Link, PlacedPatch
from skinbus.model.law import Cone, Law, Radial
from skinbus.model.patch import Patch, grid
from skinbus.model.residual_map import ResidualMap
from skinbus.model.robot import JointSettings, LinkFrame, RobotSettings
from skinbus.model.surface import Surface
from skinbus.model.transducer import Transducer

__all__ = [
    "Arm",
    "BusSettings",
    "Cone",
    "JointSettings",
    "Law",
    "Link",
    "LinkFrame",
    "Patch",
    "PlacedPatch",
    "Radial",
    "ResidualMap",
    "RobotSettings",
    "Surface",
    "Transducer",
    "grid",
]
