"""Joint positions against the limits of the URDF: degrees in place of radians are refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from skinbus.errors import ArgumentError, ConfigError, Fault, SkinbusError
from skinbus.model import Arm
from skinbus.model.robot import RobotSettings
from skinbus.robot.chain import Chain, load_chain, read_chain

SLACK_RAD: Final = 0.1
SLACK_M: Final = 0.01
"""How far positions may be beyond limits: joints are calibrated to a degree or a millimetre, and go a little
beyond soft limits; degrees in place of radians, or mm in place of m, are far more."""


def check_positions(chain: Chain, positions: Sequence[tuple[int, float]]) -> None:
    """Check positions (rad or m), each after the number of its joint.

    Raises:
        ArgumentError: one is beyond the limits of its joint.
    """
    for j, value in positions:
        if _is_beyond(chain, j, value):
            unit, what = ("m", "metres, not mm") if chain.linear[j] else ("rad", "radians, not degrees")
            raise ArgumentError(
                f"joint {chain.names[j]!r} at {value:g} {unit}; wanted {chain.lower[j]:g} to "
                f"{chain.upper[j]:g} {unit}, as in the URDF: positions are in {what}"
            )


def check_robot(arm: Arm) -> None:
    """Read the URDF of an arm that has a robot and check what its arm file says of it.

    Raises:
        ConfigError: faults of the URDF, or of the arm file that goes with it.
        SkinbusError: yourdfpy is not installed.
    """
    if arm.robot is not None:
        check_fixed(load_chain(arm), arm.robot)


def robot_faults(settings: RobotSettings) -> list[Fault]:
    """Return the faults that :func:`check_robot` finds, those of a URDF under its name.

    For an arm file that is refused anyhow: without yourdfpy none are found. Of one that is not, who uses the
    robot reads the URDF.
    """
    try:
        check_fixed(read_chain(settings), settings)
    except ConfigError as error:
        return list(error.faults) if error.file == settings.file else error.under_its_name()
    except SkinbusError:
        pass
    return []


def check_fixed(chain: Chain, settings: RobotSettings) -> None:
    """Check the fixed positions of an arm file.

    Raises:
        ConfigError: some are beyond the limits of their joints.
    """
    faults: list[Fault] = []
    for joint in settings.joints:
        j = chain.find(joint.name)
        if joint.fixed is not None and _is_beyond(chain, j, joint.fixed):
            key, unit = ("fixed_mm", 1e-3) if chain.linear[j] else ("fixed_deg", math.radians(1.0))
            wish = f"{chain.lower[j] / unit:.6g} to {chain.upper[j] / unit:.6g}, as in the URDF"
            faults.append(Fault(f"{joint.key}.{key}", round(joint.fixed / unit, 6), wish))
    if faults:
        raise ConfigError(settings.file, faults)


def _is_beyond(chain: Chain, j: int, value: float) -> bool:
    """Whether a position is beyond the limits of its joint; limits that leave no range are none."""
    lower, upper = float(chain.lower[j]), float(chain.upper[j])
    if chain.kinds[j] == "continuous" or not lower < upper:
        return False
    slack = SLACK_M if chain.linear[j] else SLACK_RAD
    return not lower - slack <= value <= upper + slack
