"""Where links are drawn: on the robot at joint angles or, without a robot, one after the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm

Floats = npt.NDArray[np.float64]

GAP: Final = 0.02
"""Between links that are drawn one after the other, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Poses of the links' surfaces in the base."""

    X_BS: Floats
    """(n_links, 4, 4)"""
    note: str
    """What is assumed, for people; empty for nothing."""


def in_a_row(arm: Arm) -> Poses:
    """Return poses of links drawn one after the other along x, as they stand in the arm file."""
    X = np.tile(np.eye(4), (len(arm.links), 1, 1))
    start = 0.0
    for pose, link in zip(X, arm.links, strict=True):
        surface = link.surface
        pose[0, 3] = start
        start += float(surface.position(surface.length, 0.0)[0][0]) + GAP
    note = "the arm file has no [robot]: links are drawn in a row" if len(arm.links) > 1 else ""
    return Poses(X, note)


class RobotPoses:
    """Poses of the links of an arm with a robot, at joint positions."""

    def __init__(self, arm: Arm) -> None:
        """Raises ConfigError for faults of the URDF, SkinbusError where yourdfpy is not installed."""
        from skinbus.robot.frames import RobotFrames

        if arm.robot is None:
            raise ValueError(f"{arm.name} has no [robot]")
        self._frames = RobotFrames(arm)
        self.names = self._frames.chain.names
        chain = self._frames.chain
        fixed = {joint.name: joint.fixed for joint in arm.robot.joints if joint.fixed is not None}
        middle = np.where(
            np.isfinite(chain.lower) & np.isfinite(chain.upper),
            np.clip(0.0, chain.lower, chain.upper),
            0.0,
        )
        self._still = np.array([fixed.get(n, m) for n, m in zip(self.names, middle, strict=True)], float)
        self._assumed = [name for name in self.names if name not in fixed]

    def at(self, positions: Floats | None) -> Poses:
        """Return the poses at positions (n_joints,), rad or m; None where they are not known."""
        q = self._still if positions is None else positions
        X = self._frames.surface_poses(q)
        unknown = positions is None and self._assumed
        note = f"positions are not known of {', '.join(self._assumed)}: drawn at 0" if unknown else ""
        return Poses(X, note)


def placed(X: Floats, points: npt.NDArray[np.floating]) -> Floats:
    """Return points (..., 3) in the frame that X (4, 4) leads to."""
    return np.asarray(points @ X[:3, :3].T + X[:3, 3])


def turned(X: Floats, vectors: npt.NDArray[np.floating]) -> Floats:
    """Return directions (..., 3) in the frame that X (4, 4) leads to."""
    return np.asarray(vectors @ X[:3, :3].T)
