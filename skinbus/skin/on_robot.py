"""One contact in the frames of the robot, as programs see it: NaN where a frame is not known now."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, Self

import numpy as np
import numpy.typing as npt

from skinbus.errors import ArgumentError, LocalProtocolError

if TYPE_CHECKING:
    from skinbus.robot import RobotContacts

Floats = npt.NDArray[np.float64]
Frame = Literal["surface", "link", "base", "tool"]

_ROWS: Final = {"link": 0, "base": 1, "tool": 2}
"""Frames in the order of the arrays of ``RobotContacts``."""


class Vector(np.ndarray[Any, np.dtype[np.float64]]):
    """A vector (3,) in the frame of the link's surface; called, that in a frame, "base" by default."""

    _in: Callable[[Frame], Floats] | None = None

    @classmethod
    def of(cls, values: Floats, in_frame: Callable[[Frame], Floats]) -> Self:
        """Return these values, with what gives them in a frame."""
        vector = np.asarray(values, np.float64).view(cls)
        vector._in = in_frame
        return vector

    def __call__(self, frame: Frame = "base") -> Floats:
        """Return the vector in frame "surface", "link", "base" or "tool", (3,)."""
        if self._in is None:
            raise TypeError("only the point and the normal of a contact are known in several frames")
        return self._in(frame)


@dataclass(frozen=True, slots=True, eq=False)
class OnRobot:
    """A contact on the robot; ``row`` is that in ``robot``, -1 where it is not seen in the cycle."""

    point_S: Floats
    normal_S: Floats
    X_LS: Floats | None
    """(4, 4) pose of the surface in the URDF's link; None where it is not known."""
    has_robot: bool
    robot: RobotContacts | None
    row: int

    def point(self, frame: Frame) -> Floats:
        """Return the point in a frame, (3,) m."""
        if frame in ("surface", "link"):
            R, p = self._to_link(frame)
            return np.asarray(R @ self.point_S + p)
        return self._placed("point", frame, (3,))

    def normal(self, frame: Frame) -> Floats:
        """Return the outward unit normal in a frame, (3,)."""
        if frame in ("surface", "link"):
            return np.asarray(self._to_link(frame)[0] @ self.normal_S)
        return self._placed("normal", frame, (3,))

    def covariance(self, frame: Frame) -> Floats:
        """Return the covariance of the point in a frame, (3, 3) m^2; NaN where it is not known."""
        if frame == "surface":
            raise ArgumentError("the covariance of a point is given in frame 'link', 'base' or 'tool'")
        return self._placed("covariance", frame, (3, 3))

    def jacobian(self) -> Floats:
        """Return that of the point in the base, (6, n_joints)."""
        if self.robot is None or self.row < 0:
            self._check("base")
            n = 0 if self.robot is None else self.robot.jacobian.shape[2]
            return np.full((6, n), np.nan)
        return np.asarray(self.robot.jacobian[self.row])

    def _to_link(self, frame: Frame) -> tuple[Floats, Floats]:
        """Return rotation and origin of the surface in "surface" or "link"."""
        if frame == "surface":
            return np.eye(3), np.zeros(3)
        if self.X_LS is None:
            raise LocalProtocolError("this source carries points in frame 'surface' only")
        return self.X_LS[:3, :3], self.X_LS[:3, 3]

    def _placed(self, name: str, frame: Frame, shape: tuple[int, ...]) -> Floats:
        """Return the row of a column in a frame; NaN where it is not known."""
        self._check(frame)
        if self.robot is None or self.row < 0:
            return np.full(shape, np.nan)
        return np.asarray(getattr(self.robot, name)[self.row, _ROWS[frame]])

    def _check(self, frame: Frame) -> None:
        if frame not in _ROWS:
            raise ArgumentError(f"no frame {frame!r}; wanted 'surface', 'link', 'base' or 'tool'")
        if not self.has_robot:
            raise LocalProtocolError(NO_ROBOT)


NO_ROBOT: Final = (
    "frames and torques need [robot] in the arm file; shared memory needs that file: attach(NAME, arm=...)"
)
