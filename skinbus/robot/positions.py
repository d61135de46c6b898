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
from bisect import bisect_right
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.errors import ArgumentError
from skinbus.model.robot import RobotSettings
from skinbus.printable import shown_value
from skinbus.robot.chain import Chain

Floats = npt.NDArray[np.float64]

KEPT: Final = 64
"""Positions of a joint: those of a loop of 1 kHz that have come since a SYNC of 20 Hz, and two before."""


class JointPositions:
    """The positions of the joints of a chain: from Python, or fixed."""

    def __init__(self, chain: Chain, settings: RobotSettings) -> None:
        said = {joint.name: joint for joint in settings.joints}
        self.names = chain.names
        self.max_age_ns = settings.max_age_ns
        self._continuous = [kind == "continuous" for kind in chain.kinds]
        self._velocity = chain.velocity.tolist()
        self._sd = [said[name].sd if name in said else 0.0 for name in chain.names]
        self._fixed = [said[name].fixed if name in said else None for name in chain.names]
        self._came: list[list[tuple[int, float]]] = [[] for _ in chain.names]
        """Times and positions of each joint, times growing."""
        self._from_python = [
            j for j, name in enumerate(chain.names) if name not in said or said[name].fixed is None
        ]

    @property
    def from_python(self) -> tuple[str, ...]:
        """Names of the joints that :meth:`set` sets: those that are not fixed."""
        return tuple(self.names[j] for j in self._from_python)

    def set(self, t_ns: int, positions: npt.ArrayLike | Mapping[str, float]) -> None:
        """Take positions of a time: a number for each joint of :attr:`from_python`, or some by name.

        Raises:
            ArgumentError: a number of them, a name or a value that cannot be; nothing is taken then.
        """
        self.put_all((joint, t_ns, value) for joint, value in self.resolve(positions))

    def resolve(self, positions: npt.ArrayLike | Mapping[str, float]) -> list[tuple[int, float]]:
        """Return the joints that positions are of, and their values, as :meth:`set` takes them.

        Raises:
            ArgumentError: as :meth:`set`.
        """
        joints, given = self._from_python, positions
        if isinstance(positions, Mapping):
            unknown = [name for name in positions if name not in self.from_python]
            if unknown:
                wanted = ", ".join(self.from_python) or "none: all are fixed"
                raise ArgumentError(f"no joint {unknown[0]!r} to be set; wanted {wanted}")
            joints, given = [self.names.index(name) for name in positions], list(positions.values())
        try:
            values = np.asarray(given, np.float64)
        except (TypeError, ValueError):
            raise ArgumentError(f"positions must be numbers, got {shown_value(given)}") from None
        if values.shape != (len(joints),):
            raise ArgumentError(
                f"positions of shape {values.shape}; wanted ({len(joints)},): {self.from_python}"
            )
        if np.ma.is_masked(given) or not np.isfinite(values).all():
            raise ArgumentError(f"positions must be finite, got {shown_value(given)}")
        return list(zip(joints, values.tolist(), strict=True))

    def put_all(self, came: Iterable[tuple[int, int, float]]) -> None:
        """Take positions as they came: joint, time, position.

        A position takes the place of those of the same and of later times.
        """
        for joint, t_ns, position in came:
            kept = self._came[joint]
            if self._continuous[joint] and kept:  # the short way round
                position += math.tau * round((kept[-1][1] - position) / math.tau)
            while kept and kept[-1][0] >= t_ns:
                kept.pop()
            kept.append((t_ns, position))
            del kept[:-KEPT]

    def at(self, t_ns: int) -> tuple[Floats, Floats] | None:
        """Return positions (n_joints,) and standard deviations at a time; None if one is not known.

        A joint is known when the newest position before the time is at most ``max_age_ns`` older than it.
        """
        found = []
        for j, fixed in enumerate(self._fixed):
            known = (fixed, 0.0) if fixed is not None else self._one_at(j, t_ns)
            if known is None:
                return None
            found.append((known[0], math.hypot(self._sd[j], known[1])))
        position, deviation = np.array(found, np.float64).reshape(-1, 2).T
        return position, deviation

    def _one_at(self, j: int, t_ns: int) -> tuple[float, float] | None:
        """Return the position of a joint, and how far it may be off by how the joint moved."""
        came = self._came[j]
        k = bisect_right(came, (t_ns, math.inf)) - 1
        if k < 0:
            return None
        # up to three that follow each other, around the time if possible
        picked = [k]
        for i, beside in ((k + 1, k), (k - 1, k), (k + 2, k + 1), (k - 2, k - 1)):
            is_next = len(picked) < 3 and beside in picked and 0 <= i < len(came)
            if is_next and abs(came[i][0] - came[beside][0]) <= self.max_age_ns:
                picked.append(i)
        since = t_ns - came[k][0]
        if k + 1 not in picked and since > self.max_age_ns:
            return None
        (t, position), *others = (came[i] for i in picked)
        if others:
            (t_1, q_1) = others[0]
            slope = (q_1 - position) / (t_1 - t)
            position += slope * since
        if len(others) == 2:
            t_2, q_2 = others[1]
            bend = ((q_2 - q_1) / (t_2 - t_1) - slope) / (t_2 - t)
            return position, bend * since * (t_ns - t_1)
        near = min([since, *(abs(t_ns - t_1) for t_1, _ in others)])
        if near and not self._velocity[j] < math.inf:
            return None
        return position, 1e-9 * self._velocity[j] * near if near else 0.0
