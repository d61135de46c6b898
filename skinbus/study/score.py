"""Contacts held against true touches: found, missed, false, and how far off."""

from __future__ import annotations

from typing import Any, NamedTuple, TypedDict

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.integer[Any]]

GATE = 0.020
"""A contact further than this from a touch is not that touch, m: two tactels of the default board."""

FOUND_SHARE = 0.9
"""A touch is found when it has a contact in this share of its steady cycles: a lost frame is forgiven."""


class ErrorSpread(TypedDict):
    """Median and 95th percentile."""

    median: float
    p95: float


class Points(NamedTuple):
    """Contacts or touches as columns: identity, link, s and a (m), force (N)."""

    ids: Ints
    link: Ints
    s: Floats
    a: Floats
    force: Floats


class Score:
    """Gathers matches cycle by cycle; only cycles whose truth is steady are given to it."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._cycles_of: dict[int, int] = {}
        self._found_in: dict[int, int] = {}
        self._false: set[int] = set()
        self._position: list[float] = []
        self._force: list[float] = []

    def add(self, touches: Points, contacts: Points) -> None:
        """Match the contacts of one cycle to its touches, each to at most one, nearest in sum."""
        for touch in touches.ids.tolist():
            self._cycles_of[touch] = self._cycles_of.get(touch, 0) + 1
        d = self._distances(touches, contacts)
        # Outside the gate every distance is equally bad: such pairs are dropped after the assignment.
        rows, columns = linear_sum_assignment(np.minimum(d, 10.0 * GATE))
        near = d[rows, columns] <= GATE
        rows, columns = rows[near], columns[near]
        for touch in touches.ids[rows].tolist():
            self._found_in[touch] = self._found_in.get(touch, 0) + 1
        self._position += d[rows, columns].tolist()
        off = np.abs(contacts.force[columns] - touches.force[rows]) / touches.force[rows]
        self._force += off.tolist()
        self._false.update(np.delete(contacts.ids, columns).tolist())

    @property
    def touches(self) -> int:
        """Number of touches seen in steady cycles."""
        return len(self._cycles_of)

    @property
    def missed(self) -> int:
        """Touches that had no contact in too many of their cycles."""
        return sum(self._found_in.get(t, 0) < FOUND_SHARE * n for t, n in self._cycles_of.items())

    @property
    def false(self) -> int:
        """Contacts, counted once per identity, that stood where no touch was."""
        return len(self._false)

    def position_mm(self) -> ErrorSpread:
        """Return the spread of distances between contact and touch, mm."""
        return _spread(self._position, 1e3)

    def force_pct(self) -> ErrorSpread:
        """Return the spread of relative force errors, %."""
        return _spread(self._force, 1e2)

    def _distances(self, touches: Points, contacts: Points) -> Floats:
        """Return geodesic distances (n_touches, n_contacts) m; infinite between links."""
        d = np.full((len(touches.ids), len(contacts.ids)), np.inf)
        for number, link in enumerate(self._arm.links):
            t = np.flatnonzero(touches.link == number)
            c = np.flatnonzero(contacts.link == number)
            d[np.ix_(t, c)] = link.surface.distance(
                touches.s[t, None], touches.a[t, None], contacts.s[c], contacts.a[c]
            )
        return d


def _spread(values: list[float], scale: float) -> ErrorSpread:
    if not values:
        return {"median": float("nan"), "p95": float("nan")}
    median, p95 = np.percentile(values, [50, 95]) * scale
    return {"median": round(float(median), 3), "p95": round(float(p95), 3)}
