"""Where links are drawn: on the robot at joint angles or, without a robot, one after the other."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats
from skinbus.model import Arm

LEAST_TURN = 1e-3
"""Change of a joint position, rad or m, from which on the links are drawn elsewhere: less is not seen."""
GAP = 0.02
"""Between links that are drawn one after the other, m."""


class Poses:
    """Poses of the links' surfaces in the base: at joint positions that may change, or in a row."""

    def __init__(self, arm: Arm) -> None:
        """Draw it at rest.

        Raises:
            ConfigError: faults of the URDF.
            SkinbusError: yourdfpy is not installed.
        """
        self.X_BS: Floats = np.tile(np.eye(4), (len(arm.links), 1, 1))
        """(n_links, 4, 4)"""
        self.note = ""
        """What is assumed, for people; empty for nothing."""
        self.bones: Floats = np.zeros((0, 2, 3))
        """(n, 2, 3) lines from joint to joint of the robot, and to its tool, m."""
        self._frames = None
        if arm.robot is None:
            lengths = [float(link.surface.position(link.surface.length, 0.0)[0][0]) for link in arm.links]
            self.X_BS[1:, 0, 3] = np.cumsum(lengths[:-1]) + GAP * np.arange(1, len(lengths))
            if len(lengths) > 1:
                self.note = "the arm file has no [robot]: links are drawn in a row"
            return
        from skinbus.robot.frames import RobotFrames  # nobody else pays for it

        self._frames = RobotFrames(arm)
        chain = self._frames.chain
        fixed = arm.robot.fixed
        rest = np.clip(0.0, chain.lower, chain.upper)
        self.positions = np.array([fixed.get(n, q) for n, q in zip(chain.names, rest, strict=True)], float)
        """(n_joints,) rad or m, in the order of the chain."""
        self._stand()
        if unknown := [name for name in chain.names if name not in fixed]:
            self.note = f"positions are not known of {', '.join(unknown)}: drawn at 0"

    @property
    def joints(self) -> dict[str, float]:
        """Joint positions by name; none without a robot."""
        frames = self._frames
        return dict(zip(frames.chain.names, self.positions.tolist(), strict=True)) if frames else {}

    def move(self, positions: Floats) -> bool:
        """Go to joint positions; return whether that is further than can be seen.

        Positions that are not known are passed over.
        """
        if self._frames is None or not len(positions) or not np.isfinite(positions).all():
            return False
        if not self.note and np.abs(positions - self.positions).max() < LEAST_TURN:
            return False
        self.positions, self.note = positions.copy(), ""
        self._stand()
        return True

    def _stand(self) -> None:
        """Compute where links and joints are at the positions."""
        assert self._frames is not None
        chain, (X_BJ, X_BF) = self._frames.chain, self._frames.poses(self.positions)
        self.X_BS = X_BF[: len(self.X_BS)]
        begins = X_BJ[[*chain.parent, chain.carrier[-1]], :3, 3]
        self.bones = np.stack([begins, [*X_BJ[:-1, :3, 3], X_BF[-1, :3, 3]]], 1)


def placed(X: Floats, points: npt.NDArray[np.floating]) -> Floats:
    """Return points (..., 3) in the frame that X (4, 4) leads to."""
    return np.asarray(points @ X[:3, :3].T + X[:3, 3])


def turned(X: Floats, vectors: npt.NDArray[np.floating]) -> Floats:
    """Return directions (..., 3) in the frame that X (4, 4) leads to."""
    return np.asarray(vectors @ X[:3, :3].T)
