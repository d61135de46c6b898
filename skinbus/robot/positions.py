"""Joint positions over time: kept as they come, given for the time of a SYNC, withheld when they are too old.

Of each joint the last three positions are kept. Between two, and for a while after the newest, a joint is
taken to move evenly (the line through the two). What the third shows of its acceleration is not used to
correct the position but added to its standard deviation: the quadratic term of Newton's interpolation,

    |q[t0, t1, t2] (t - ta) (t - tb)|.

Assumption: joints move without jumps of their velocity. Failure: a stop between two positions is noticed with
the next one.
Source: J. Stoer, R. Bulirsch, Introduction to Numerical Analysis (2002), 2.1.3.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from skinbus.model.robot import RobotSettings
from skinbus.robot.chain import Chain

Floats = npt.NDArray[np.float64]

KEPT = 3
"""Positions of a joint: two for its velocity, one more for what its acceleration may be."""
NEVER = -(1 << 62)
"""Time of a position that has not come."""


class JointPositions:
    """The positions of the joints of a chain: from Python, from drives, or fixed."""

    def __init__(self, chain: Chain, settings: RobotSettings) -> None:
        n = chain.n_joints
        self.names = chain.names
        self.max_age_ns = settings.max_age_ns
        self._continuous = np.array([kind == "continuous" for kind in chain.kinds])
        self._t = np.full((KEPT, n), NEVER, np.int64)
        self._q = np.zeros((KEPT, n))
        self._sd = np.zeros(n)
        self._fixed = np.zeros(n, np.bool_)
        self._from_bus = np.zeros(n, np.bool_)
        for joint in settings.joints:
            j = chain.find(joint.name)
            self._sd[j] = joint.sd
            self._from_bus[j] = joint.node_id is not None
            if joint.fixed is not None:
                self._fixed[j] = True
                self._q[:, j] = joint.fixed
        self._from_python = np.flatnonzero(~self._fixed & ~self._from_bus)

    @property
    def from_python(self) -> tuple[str, ...]:
        """Names of the joints that :meth:`set` sets: those that are neither fixed nor of a drive."""
        return tuple(self.names[j] for j in self._from_python)

    def set(self, t_ns: int, positions: npt.ArrayLike | Mapping[str, float]) -> None:
        """Take positions of a time: a number for each joint of :attr:`from_python`, or some by name.

        Raises:
            ValueError: a number of them, a name or a value that cannot be; nothing is taken then.
        """
        for joint, value in self.resolve(positions):
            self.put(joint, t_ns, value)

    def resolve(self, positions: npt.ArrayLike | Mapping[str, float]) -> list[tuple[int, float]]:
        """Return the joints that positions are of, and their values, as :meth:`set` takes them.

        Raises:
            ValueError: as :meth:`set`.
        """
        if isinstance(positions, Mapping):
            unknown = [name for name in positions if name not in self.from_python]
            if unknown:
                wanted = ", ".join(self.from_python) or "none: all are fixed or from drives"
                raise ValueError(f"no joint {unknown[0]!r} to be set; wanted {wanted}")
            joints = np.array([self.names.index(name) for name in positions], np.intp)
            values = np.array(list(positions.values()), np.float64)
        else:
            joints = self._from_python
            values = np.asarray(positions, np.float64)
        if values.shape != (len(joints),):
            raise ValueError(
                f"positions of shape {values.shape}; wanted ({len(joints)},): {self.from_python}"
            )
        if not np.isfinite(values).all():
            raise ValueError(f"positions must be finite, got {values}")
        return list(zip(joints.tolist(), values.tolist(), strict=True))

    def put(self, joint: int, t_ns: int, position: float) -> None:
        """Take the position of one joint; one of no later time than the newest takes its place."""
        t, q = self._t[:, joint], self._q[:, joint]
        if self._continuous[joint] and t[0] != NEVER:  # the short way round
            position += 2.0 * np.pi * np.round((q[0] - position) / (2.0 * np.pi))
        if t_ns > t[0]:
            t[1:], q[1:] = t[:-1].copy(), q[:-1].copy()
        t[0], q[0] = t_ns, position

    def forget(self) -> None:
        """Forget all positions but fixed ones."""
        self._t[:] = NEVER

    def at(self, t_ns: int) -> tuple[Floats, Floats] | None:
        """Return positions (n_joints,) and standard deviations at a time; None if one is not known.

        A joint is known when three positions have come, the newest before the time is at most ``max_age_ns``
        older than it, and none of the three is older than that than the next.
        """
        t, q = self._t, self._q
        moving = ~self._fixed
        if (t[KEPT - 1, moving] == NEVER).any():
            return None
        # of the newest two, or of the two before if the time is between those
        back = (t_ns < t[1]).astype(np.intp)
        joints = np.arange(t.shape[1])
        gaps = np.where(moving, t[:-1] - t[1:], 1)
        age = np.where(moving, t_ns - t[back + 1, joints], 0)
        late = np.where(moving, t_ns - t[0], 0)
        if (age < 0).any() or late.max(initial=0) > self.max_age_ns or gaps.max(initial=0) > self.max_age_ns:
            return None
        near, far = np.where(moving, t_ns - t[back, joints], 0), age
        slopes = (q[:-1] - q[1:]) / gaps
        position = q[back, joints] + slopes[back, joints] * near
        bend = (slopes[0] - slopes[1]) / np.where(moving, t[0] - t[2], 1)
        return position, np.hypot(self._sd, bend * near * far)
