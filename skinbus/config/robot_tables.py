"""The tables of an arm file that describe the robot: ``[robot]``, ``[[joint]]``, and where links are on it.

What only the URDF contains (whether it has such links and joints) is checked where it is read, in ``robot``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from skinbus.arrays import Floats
from skinbus.config.arm_tables import LinkTable, Positive, Table, Text, beside
from skinbus.errors import Fault, FaultList
from skinbus.model.robot import JointSettings, LinkFrame, RobotSettings

NotNegative = Annotated[float, Field(ge=0.0)]


class RobotTable(Table):
    """``[robot]``: the URDF, its frames, and how old joint positions may be at the SYNC."""

    urdf: Text
    base: Text | None = None
    tool: Text | None = None
    max_age_ms: Positive | None = None
    """By default ``MAX_AGE_MS``, or ``MAX_AGE_PERIODS`` where that is more."""


MAX_AGE_MS = 50.0
"""At 1 rad/s, fast for an arm among people, joints turn by 3 degrees in this time."""

MAX_AGE_PERIODS = 1.5
"""Of the SYNC: positions that come once a cycle are up to a period old at the next one."""


class JointTable(Table):
    """``[[joint]]``: the position of a joint that never moves, and how exact one is known."""

    name: Text
    fixed_deg: float | None = None
    fixed_mm: float | None = None
    sd_deg: NotNegative | None = None
    sd_mm: NotNegative | None = None


def robot_settings(
    robot: RobotTable | None,
    joints: Sequence[tuple[str, JointTable]],
    links: Sequence[tuple[str, LinkTable]],
    rate_hz: float,
    path: Path,
    faults: FaultList,
) -> RobotSettings | None:
    """Return what the tables say of the robot, None without ``[robot]``; add their faults."""
    if robot is None:
        faults += [
            Fault(f"{key}.{name}", getattr(link, name), "[robot] beside it")
            for key, link in links
            for name in ("frame", "xyz_mm", "rpy_deg")
            if name in link.model_fields_set
        ]
        faults += [Fault(key, joint.name, "[robot] beside it") for key, joint in joints]
        return None
    usual_ms = max(MAX_AGE_MS, 1e3 * MAX_AGE_PERIODS / rate_hz)
    return RobotSettings(
        file=str(path),
        urdf=str(beside(robot.urdf, path)),
        base=robot.base,
        tool=robot.tool,
        max_age_ns=round(1e6 * (robot.max_age_ms or usual_ms)),
        links=tuple(LinkFrame(name=link.frame or link.name, X_LS=_pose(link)) for _, link in links),
        joints=tuple(_joint(key, joint, faults) for key, joint in joints),
    )


def _joint(key: str, joint: JointTable, faults: FaultList) -> JointSettings:
    given = [name for name in joint.model_fields_set if name != "name"]
    is_linear = [name.endswith("_mm") for name in given]
    if len(set(is_linear)) > 1:
        faults.add(key, " and ".join(sorted(given)), "keys in degrees or in mm, not both")
    unit, scale = ("mm", 1e-3) if any(is_linear) else ("deg", math.radians(1.0))
    fixed, sd = (getattr(joint, f"{name}_{unit}") for name in ("fixed", "sd"))
    return JointSettings(
        name=joint.name,
        fixed=None if fixed is None else scale * fixed,
        sd=scale * (sd or 0.0),
        is_linear=any(is_linear) if given else None,
        key=key,
    )


def _pose(link: LinkTable) -> Floats:
    """Return the pose of a link's surface, (4, 4): fixed axes in the order roll, pitch, yaw, as in URDF."""
    from scipy.spatial.transform import Rotation  # only who has a robot pays for it

    X = np.eye(4)
    X[:3, :3] = Rotation.from_euler("xyz", link.rpy_deg, degrees=True).as_matrix()
    X[:3, 3] = 1e-3 * np.array(link.xyz_mm)
    return X
