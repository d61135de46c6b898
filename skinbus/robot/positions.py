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
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats
from skinbus.errors import ArgumentError
from skinbus.model.robot import RobotSettings
from skinbus.printable import shown_value
from skinbus.robot.chain import Chain

KEPT = 64
"""Positions of a joint: those of a loop of 1 kHz that have come since a SYNC of 20 Hz, and two before."""


class JointPositions:
    """The positions of the joints of a chain: from Python, or fixed."""

    def __init__(self, chain: Chain, settings: RobotSettings) -> None:
        said = {joint.name: joint for joint in settings.joints}
        fixed = settings.fixed
        self.names = chain.names
        self.max_age_ns = settings.max_age_ns
        self.from_python = tuple(name for name in chain.names if name not in fixed)
        """Names of the joints that :meth:`resolve` takes: those that are not fixed."""
        self._fixed = np.array([fixed.get(name, math.nan) for name in chain.names])
        self._sd = np.array([said[name].sd if name in said else 0.0 for name in chain.names])
        self._continuous = np.array(chain.kinds) == "continuous"
        self._velocity = np.where(np.isnan(self._fixed), chain.velocity, 0.0)
        self._rows: list[tuple[int, Floats]] = []
        """Times and positions (n_joints,), times growing."""
        self._set_ns = np.full(len(chain.names), -(2**62))
        """When each joint was set last."""

    def resolve(self, positions: npt.ArrayLike | Mapping[str, float]) -> Floats:
        """Return positions (n_joints,) as :meth:`set` takes them, NaN of joints that are not named.

        Raises:
            ArgumentError: as :meth:`set`.
        """
        names, given = self.from_python, positions
        if isinstance(positions, Mapping):
            names, given = tuple(positions), list(positions.values())
            if unknown := [name for name in names if name not in self.from_python]:
                wanted = ", ".join(self.from_python) or "none: all are fixed"
                raise ArgumentError(f"no joint {unknown[0]!r} to be set; wanted {wanted}")
        try:
            values = np.asarray(given, np.float64)
        except (TypeError, ValueError):
            raise ArgumentError(f"positions must be numbers, got {shown_value(given)}") from None
        if values.shape != (len(names),):
            raise ArgumentError(f"positions of shape {values.shape}; wanted ({len(names)},): {names}")
        if np.ma.is_masked(given) or not np.isfinite(values).all():
            raise ArgumentError(f"positions must be finite, got {shown_value(given)}")
        row = self._fixed.copy()
        row[[self.names.index(name) for name in names]] = values
        return row

    def put(self, t_ns: int, row: Floats) -> None:
        """Take positions of :meth:`resolve`; they take the place of those of the same and of later times.

        A joint that is not named stays where it was, for as long as that is young enough.
        """
        rows, is_given = self._rows, np.isfinite(row)
        while rows and rows[-1][0] >= t_ns:
            rows.pop()
        if rows:
            last = rows[-1][1]
            turns = np.nan_to_num(np.round((last - row) / math.tau))  # the short way round
            row = np.where(self._continuous, row + math.tau * turns, row)
            is_held = ~is_given & (t_ns - self._set_ns <= self.max_age_ns)
            row[is_held] = last[is_held]
        self._set_ns[is_given] = t_ns
        rows.append((t_ns, row))
        del rows[:-KEPT]

    def at(self, t_ns: int) -> tuple[Floats, Floats] | None:
        """Return positions (n_joints,) and standard deviations at a time; None if one is not known.

        They are known when the newest before the time are at most ``max_age_ns`` older than it.
        """
        if not self.from_python:
            return self._fixed, self._sd
        rows = self._rows
        k = bisect_right(rows, t_ns, key=lambda row: row[0]) - 1
        if k < 0:
            return None
        # up to three that follow each other, around the time if possible
        picked = [k]
        for i, beside in ((k + 1, k), (k - 1, k), (k + 2, k + 1), (k - 2, k - 1)):
            is_next = len(picked) < 3 and beside in picked and 0 <= i < len(rows)
            if is_next and abs(rows[i][0] - rows[beside][0]) <= self.max_age_ns:
                picked.append(i)
        since = t_ns - rows[k][0]
        if k + 1 not in picked and since > self.max_age_ns:
            return None
        (t, position), *others = (rows[i] for i in picked)
        near = min([since, *(abs(t_ns - other) for other, _ in others)])
        off = 1e-9 * near * self._velocity if near else np.zeros_like(position)
        if others:
            (t_1, q_1) = others[0]
            slope = (q_1 - position) / (t_1 - t)
            position = position + slope * since
        if len(others) == 2:
            t_2, q_2 = others[1]
            bend = ((q_2 - q_1) / (t_2 - t_1) - slope) / (t_2 - t)
            off = bend * since * (t_ns - t_1)
        if not np.isfinite(position + off).all():
            return None
        return position, np.hypot(self._sd, off)
