"""Joint positions over time: kept as they come, given for the time of a SYNC, withheld when they are too old.

Between two positions, and for a while after the newest, a joint is taken to move evenly (the line through the
two). What a third one shows of its acceleration is not used to correct the position but added to its standard
deviation: the quadratic term of Newton's interpolation,

    |q[t0, t1, t2] (t - ta) (t - tb)|.

Where there are fewer than three, the URDF's limit of the velocity stands for what is not known: the joint may
have moved so fast since the nearest position. Without such a limit its position is not known.

Assumption: joints move without jumps of their velocity. Failure: a stop between two positions is detected
with the next one.
Source: J. Stoer, R. Bulirsch, Introduction to Numerical Analysis (2002), 2.1.3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from skinbus.errors import ArgumentError
from skinbus.jit import kernel
from skinbus.model.robot import RobotSettings
from skinbus.printable import shown_value
from skinbus.robot.chain import Chain

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

KEPT = 64
"""Positions of a joint: those of a loop of 1 kHz that have come since a SYNC of 20 Hz, and two before."""
NEVER = -(1 << 62)
"""Time of a position that has not come."""


class JointPositions:
    """The positions of the joints of a chain: from Python, from drives, or fixed."""

    def __init__(self, chain: Chain, settings: RobotSettings) -> None:
        n = chain.n_joints
        self.names = chain.names
        self.max_age_ns = settings.max_age_ns
        self._continuous = np.array([kind == "continuous" for kind in chain.kinds], np.bool_)
        self._velocity = chain.velocity
        # rings of each joint, and where the newest is
        self._t = np.full((n, KEPT), NEVER, np.int64)
        self._q = np.zeros((n, KEPT))
        self._newest = np.zeros(n, np.int64)
        self._sd = np.zeros(n)
        self._fixed = np.zeros(n, np.bool_)
        self._from_bus = np.zeros(n, np.bool_)
        for joint in settings.joints:
            j = chain.find(joint.name)
            self._sd[j] = joint.sd
            self._from_bus[j] = joint.node_id is not None
            if joint.fixed is not None:
                self._fixed[j] = True
                self._q[j] = joint.fixed
        self._from_python = np.flatnonzero(~self._fixed & ~self._from_bus)
        self.at(0)  # compiled now, not in a cycle
        nothing = np.zeros(0, np.int64)
        put_positions(nothing, nothing, np.zeros(0), self._continuous, self._t, self._q, self._newest)

    @property
    def from_python(self) -> tuple[str, ...]:
        """Names of the joints that :meth:`set` sets: those that are neither fixed nor of a drive."""
        return tuple(self.names[j] for j in self._from_python)

    def set(self, t_ns: int, positions: npt.ArrayLike | Mapping[str, float]) -> None:
        """Take positions of a time: a number for each joint of :attr:`from_python`, or some by name.

        Raises:
            ArgumentError: a number of them, a name or a value that cannot be; nothing is taken then.
        """
        for joint, value in self.resolve(positions):
            self.put(joint, t_ns, value)

    def resolve(self, positions: npt.ArrayLike | Mapping[str, float]) -> list[tuple[int, float]]:
        """Return the joints that positions are of, and their values, as :meth:`set` takes them.

        Raises:
            ArgumentError: as :meth:`set`.
        """
        if isinstance(positions, Mapping):
            unknown = [name for name in positions if name not in self.from_python]
            if unknown:
                wanted = ", ".join(self.from_python) or "none: all are fixed or from drives"
                raise ArgumentError(f"no joint {unknown[0]!r} to be set; wanted {wanted}")
            joints = np.array([self.names.index(name) for name in positions], np.intp)
            values = _numbers(list(positions.values()))
        else:
            joints = self._from_python
            values = _numbers(positions)
        if values.shape != (len(joints),):
            raise ArgumentError(
                f"positions of shape {values.shape}; wanted ({len(joints)},): {self.from_python}"
            )
        if not np.isfinite(values).all():
            raise ArgumentError(f"positions must be finite, got {values}")
        return list(zip(joints.tolist(), values.tolist(), strict=True))

    def put(self, joint: int, t_ns: int, position: float) -> None:
        """Take the position of one joint; it takes the place of those of the same and of later times."""
        self.put_all([(joint, t_ns, position)])

    def put_all(self, came: Sequence[tuple[int, int, float]]) -> None:
        """Take positions as they came: joint, time, position; see :meth:`put`."""
        joints, times, values = zip(*came, strict=True)
        put_positions(
            np.array(joints, np.int64),
            np.array(times, np.int64),
            np.array(values, np.float64),
            self._continuous,
            self._t,
            self._q,
            self._newest,
        )

    def forget(self) -> None:
        """Discard all positions but fixed ones."""
        self._t[:] = NEVER

    def at(self, t_ns: int) -> tuple[Floats, Floats] | None:
        """Return positions (n_joints,) and standard deviations at a time; None if one is not known.

        A joint is known when the newest position before the time is at most ``max_age_ns`` older than it.
        """
        position, deviation = np.empty(len(self._sd)), np.empty(len(self._sd))
        is_known = positions_at(
            t_ns,
            self.max_age_ns,
            self._t,
            self._q,
            self._newest,
            self._fixed,
            self._sd,
            self._velocity,
            position,
            deviation,
        )
        return (position, deviation) if is_known else None


def _numbers(values: npt.ArrayLike) -> Floats:
    """Return values as numbers; ArgumentError where they are none."""
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise ArgumentError(f"positions must be numbers, got {shown_value(values)}") from None


@kernel
def put_positions(
    joints: Ints,
    times: Ints,
    values: Floats,
    continuous: npt.NDArray[np.bool_],
    t: Ints,
    q: Floats,
    newest: Ints,
) -> None:
    """Take positions (n,) into the rings of their joints, in the order in which they came."""
    for i in range(len(joints)):
        j, position = joints[i], values[i]
        k = newest[j]
        if continuous[j] and t[j, k] != NEVER:  # the short way round
            turns = np.rint((q[j, k] - position) / math.tau)
            position += math.tau * turns
        while t[j, k] >= times[i]:
            t[j, k] = NEVER
            k = (k - 1) % KEPT
        k = (k + 1) % KEPT
        t[j, k], q[j, k] = times[i], position
        newest[j] = k


@kernel
def positions_at(
    t_ns: int,
    max_age_ns: int,
    t: Ints,
    q: Floats,
    newest: Ints,
    fixed: npt.NDArray[np.bool_],
    sd: Floats,
    velocity: Floats,
    position: Floats,
    deviation: Floats,
) -> bool:
    """Write positions at a time and their standard deviations; False if one is not known.

    t, q (n_joints, KEPT) rings; newest, fixed, sd, velocity (n_joints,); see the module.
    """
    for j in range(len(sd)):
        if fixed[j]:
            position[j], deviation[j] = q[j, 0], sd[j]
            continue
        # the newest position of no later time, and the one after it if there is one
        after, k = -1, newest[j]
        for _ in range(KEPT):
            if t[j, k] <= t_ns:
                break
            after, k = k, (k - 1) % KEPT
        if t[j, k] > t_ns or t[j, k] == NEVER:
            return False
        before, third = (k - 1) % KEPT, -1
        if after >= 0 and t[j, after] - t[j, k] > max_age_ns:
            after = -1
        if after < 0 and t_ns - t[j, k] > max_age_ns:
            return False
        # t[before] may be that of a position that has not come, and the difference still fits
        has_before = t[j, before] != NEVER and t[j, before] < t[j, k]
        has_before = has_before and t[j, k] - t[j, before] <= max_age_ns
        if after >= 0:
            other = after
            if has_before:
                third = before
            else:
                later = (after + 1) % KEPT
                if after != newest[j] and t[j, later] - t[j, after] <= max_age_ns:
                    third = later
        else:
            other = before if has_before else -1
            if has_before:
                earlier = (before - 1) % KEPT
                is_there = t[j, earlier] != NEVER and t[j, earlier] < t[j, before]
                if is_there and t[j, before] - t[j, earlier] <= max_age_ns:
                    third = earlier
        near = float(t_ns - t[j, k])
        position[j] = q[j, k]
        if other >= 0:
            slope = (q[j, other] - q[j, k]) / (t[j, other] - t[j, k])
            position[j] += slope * near
        if third >= 0:
            steep = (q[j, third] - q[j, other]) / (t[j, third] - t[j, other])
            bend = (steep - slope) / (t[j, third] - t[j, k])
            doubt = bend * near * float(t_ns - t[j, other])
        else:
            if other >= 0:
                near = min(near, abs(float(t_ns - t[j, other])))
            if not velocity[j] < np.inf and near > 0.0:
                return False
            doubt = 1e-9 * velocity[j] * near if near > 0.0 else 0.0
        deviation[j] = math.hypot(sd[j], doubt)
    return True
