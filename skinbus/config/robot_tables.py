"""The tables of an arm file that describe the robot: ``[robot]``, ``[[joint]]``, and where links are on it.

What only the URDF contains (whether it has such links and joints) is checked where it is read, in ``robot``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from skinbus.config.arm_tables import LinkTable, Positive, Table, Text, beside, eds_beside
from skinbus.errors import Fault
from skinbus.model.robot import JointSettings, LinkFrame, RobotSettings

NotNegative = Annotated[float, Field(ge=0.0)]


class RobotTable(Table):
    """``[robot]``: the URDF, its frames, and how old joint positions may be at the SYNC."""

    urdf: Text
    base: Text | None = None
    tool: Text | None = None
    max_age_ms: Positive | None = None
    """By default ``MAX_AGE_MS``, or ``MAX_AGE_PERIODS`` where that is more."""


MAX_AGE_MS: Final = 50.0
"""At 1 rad/s, fast for an arm among people, joints turn by 3 degrees in this time."""

MAX_AGE_PERIODS: Final = 1.5
"""Of the SYNC: positions that come once a cycle are up to a period old at the next one."""


class JointTable(Table):
    """``[[joint]]``: where the position of a joint comes from, and how exact it is."""

    name: Text
    fixed_deg: float | None = None
    fixed_mm: float | None = None
    node_id: Annotated[int, Field(ge=1, le=127)] | None = None
    bus: str | None = None
    eds: Text | None = None
    counts_per_turn: Positive | None = None
    counts_per_mm: Positive | None = None
    sign: Literal[1, -1] = 1
    offset_deg: float | None = None
    offset_mm: float | None = None
    sd_deg: NotNegative | None = None
    sd_mm: NotNegative | None = None


_TURNING = ("fixed_deg", "counts_per_turn", "offset_deg", "sd_deg")
_LINEAR = ("fixed_mm", "counts_per_mm", "offset_mm", "sd_mm")
_OF_DRIVE = ("bus", "eds", "counts_per_turn", "counts_per_mm", "offset_deg", "offset_mm")


def robot_settings(
    robot: RobotTable | None,
    joints: Sequence[tuple[str, JointTable]],
    links: Sequence[tuple[str, LinkTable]],
    buses: Sequence[str],
    rate_hz: float,
    path: Path,
    faults: list[Fault],
) -> RobotSettings | None:
    """Return what the tables say of the robot, None without ``[robot]``; add their faults."""
    if robot is None:
        for key, link in links:
            for name in ("frame", "xyz_mm", "rpy_deg"):
                if name in link.model_fields_set:
                    faults.append(Fault(f"{key}.{name}", getattr(link, name), "[robot] beside it"))
        faults += [Fault(key, joint.name, "[robot] beside it") for key, joint in joints]
        return None
    seen: dict[str, str] = {}
    for key, joint in joints:
        if joint.name in seen:
            faults.append(Fault(f"{key}.name", joint.name, f"a name other than that of {seen[joint.name]}"))
        seen.setdefault(joint.name, key)
        _check_joint(key, joint, buses, faults)
    usual_ms = max(MAX_AGE_MS, 1e3 * MAX_AGE_PERIODS / rate_hz)
    return RobotSettings(
        file=str(path),
        urdf=str(beside(robot.urdf, path)),
        base=robot.base,
        tool=robot.tool,
        max_age_ns=round(1e6 * (robot.max_age_ms or usual_ms)),
        links=tuple(LinkFrame(name=link.frame or link.name, X_LS=_pose(link)) for _, link in links),
        joints=tuple(_joint(key, joint, buses, path) for key, joint in joints),
    )


def _check_joint(key: str, joint: JointTable, buses: Sequence[str], faults: list[Fault]) -> None:
    turning = [name for name in _TURNING if getattr(joint, name) is not None]
    linear = [name for name in _LINEAR if getattr(joint, name) is not None]
    if turning and linear:
        faults.append(Fault(key, f"{turning[0]} and {linear[0]}", "keys in degrees or in mm, not both"))
    fixed = joint.fixed_deg is not None or joint.fixed_mm is not None
    if fixed and joint.node_id is not None:
        faults.append(Fault(f"{key}.node_id", joint.node_id, "a fixed position or a drive, not both"))
    if joint.node_id is None:
        given = [name for name in _OF_DRIVE if getattr(joint, name) is not None]
        faults += [Fault(f"{key}.{name}", getattr(joint, name), "node_id beside it") for name in given]
        return
    if joint.eds is None:
        faults.append(Fault(f"{key}.eds", None, "the EDS or DCF of the drive"))
    if joint.counts_per_turn is None and joint.counts_per_mm is None:
        faults.append(Fault(f"{key}.counts_per_turn", None, "counts of 0x6064 a turn, or counts_per_mm"))
    if joint.bus is None and len(buses) > 1:
        faults.append(Fault(f"{key}.bus", None, f"the name of a bus: {', '.join(buses)}"))
    elif joint.bus is not None and joint.bus not in buses:
        wanted = f"the name of a bus: {', '.join(buses)}" if buses else "no such key: there is no [[bus]]"
        faults.append(Fault(f"{key}.bus", joint.bus, wanted))


def _joint(key: str, joint: JointTable, buses: Sequence[str], path: Path) -> JointSettings:
    degrees, mm = math.radians(1.0), 1e-3
    is_linear = any(getattr(joint, name) is not None for name in _LINEAR)
    is_turning = any(getattr(joint, name) is not None for name in _TURNING)
    unit = mm if is_linear else degrees
    per_unit = (joint.counts_per_mm or 0.0) / mm + (joint.counts_per_turn or 0.0) / math.tau
    fixed = joint.fixed_mm if is_linear else joint.fixed_deg
    return JointSettings(
        name=joint.name,
        fixed=None if fixed is None else unit * fixed,
        node_id=joint.node_id,
        bus=buses.index(joint.bus) if joint.bus in buses else 0,
        eds=eds_beside(joint.eds or "", path),
        counts_per_unit=joint.sign * per_unit,
        offset=unit * ((joint.offset_mm if is_linear else joint.offset_deg) or 0.0),
        sd=unit * ((joint.sd_mm if is_linear else joint.sd_deg) or 0.0),
        is_linear=is_linear if is_linear or is_turning else None,
        key=key,
    )


def _pose(link: LinkTable) -> npt.NDArray[np.float64]:
    """Return the pose of a link's surface, (4, 4): fixed axes in the order roll, pitch, yaw, as in URDF."""
    roll, pitch, yaw = (math.radians(angle) for angle in link.rpy_deg)
    X = np.eye(4)
    for angle, (i, j) in ((roll, (1, 2)), (pitch, (2, 0)), (yaw, (0, 1))):
        R = np.eye(4)
        R[i, i] = R[j, j] = math.cos(angle)
        R[j, i], R[i, j] = math.sin(angle), -math.sin(angle)
        X = R @ X
    X[:3, 3] = 1e-3 * np.array(link.xyz_mm)
    return X
