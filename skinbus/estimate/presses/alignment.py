"""Whether presses lie where their file says: other units, axes, boards and rows are tried in turn.

What readings alone say of the place (``read_uv``) needs no calibration. It is compared with what the file
says under each hypothesis: the median distance of the two is a fraction of the pitch where the hypothesis is
true, and that of random places where it is not. Outliers, up to half of the presses, do not change a median.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from skinbus.estimate.presses.table import (
    Floats,
    Ints,
    PressTable,
    read_uv,
)
from skinbus.model import Surface

RIM = 0.3
"""Pitches around the tactels beyond which a place is compared as if it were there: a centroid is never."""
SUSPECT, BETTER = 0.3, 0.6
"""Places deviate from readings by a quarter of the pitch where they are true. From this part of it on other
hypotheses are looked at; one is named that leaves at most that part of the deviation."""
SHIFTED = 0.5
"""Pitches of shift that centroids show without doubt; less is left to the law, which shows 0.1 mm."""
FEWEST = 8
"""Presses below which medians compare nothing."""
LAGS = 3
"""Rows by which places and readings may have slipped."""
SWITCH = 3.0
"""What a change of the lag costs, in pitches of deviation: three rows in a row or more pay for it."""

BOARD: dict[str, tuple[tuple[int, int], tuple[int, int]]] = {
    "u and v swapped": ((0, 1), (1, 0)),
    "the board mirrored in u": ((-1, 0), (0, 1)),
    "the board mirrored in v": ((1, 0), (0, -1)),
    "the board turned by 180 degrees": ((-1, 0), (0, -1)),
    "the board turned by 90 degrees": ((0, -1), (1, 0)),
    "the board turned by -90 degrees": ((0, 1), (-1, 0)),
    "u and v swapped and both mirrored": ((0, -1), (-1, 0)),
}
UNITS = {"m": 1e3, "cm": 10.0, "inches": 25.4, "um": 1e-3}
"""Factors from what was written as mm to what it was."""


class Misplacement(NamedTuple):
    """What explains the places of a patch's presses better than the file does."""

    patch: int
    name: str
    """What to assume, as in: with u and v swapped."""
    s: Floats
    a: Floats
    """(n_rows,) m, where its presses are then."""
    before: float
    after: float
    """Median deviation of places from readings as the file is, and then; m."""


def find_misplaced(table: PressTable) -> list[Misplacement]:
    """Return for each patch whose presses lie elsewhere than the file says where they do."""
    read = read_uv(table)
    found = []
    for p in np.unique(table.patch):
        rows = np.flatnonzero((table.patch == p) & np.isfinite(read[:, 0]))
        if len(rows) >= FEWEST:
            found += _of_patch(table, int(p), rows, read[rows])
    return found


def _of_patch(table: PressTable, p: int, rows: Ints, read: Floats) -> list[Misplacement]:
    arm = table.arm
    placed = arm.patches[p]
    uv = np.asarray(placed.patch.tactels_uv)
    pitch = placed.patch.pitch
    low, high = uv.min(axis=0) - RIM * pitch, uv.max(axis=0) + RIM * pitch

    def deviation(at: Floats) -> float:
        return float(np.median(np.hypot(*(np.clip(at, low, high) - read).T)))

    surface = arm.links[placed.link].surface
    given = arm.on_board(p, table.s[rows], table.a[rows])
    before = deviation(given)
    every = table.patch == p
    if before < SUSPECT * pitch:
        return []
    best: tuple[float, str, Floats, Floats] | None = None
    s, a = table.s[every], table.a[every]
    picked = np.isin(np.flatnonzero(every), rows)
    for name, s_then, a_then in _hypotheses(table, p, surface, s, a):
        after = deviation(arm.on_board(p, s_then[picked], a_then[picked]))
        # the first in the list wins among those that fit about as well
        if best is None or after < 0.8 * best[0]:
            best = after, name, s_then, a_then
    if best is None or best[0] > BETTER * before or best[0] > SHIFTED * pitch:
        shifted = np.median(read - given, axis=0)
        at = arm.on_link(p, arm.on_board(p, s, a) + shifted)
        after = deviation(given + shifted)
        if after < BETTER * before and np.hypot(*shifted) > SHIFTED * pitch:
            name = f"a shift by {1e3 * shifted[0]:.1f} mm in u and {1e3 * shifted[1]:.1f} mm in v"
            name += _owner(table, p, given)
            return [Misplacement(p, name, *at, before, after)]
    if best is not None and best[0] <= BETTER * before:
        return [Misplacement(p, best[1], best[2], best[3], before, best[0])]
    return []


def _hypotheses(
    table: PressTable, p: int, surface: Surface, s: Floats, a: Floats
) -> Iterator[tuple[str, Floats, Floats]]:
    """Yield names and the places on the chart that they imply."""
    arm, placed = table.arm, table.arm.patches[p]
    for unit, factor in UNITS.items():
        yield f"places in {unit}, not mm", factor * s, factor * a
    yield "s and a swapped", a, s
    for unit, factor in UNITS.items():
        yield f"s and a swapped and in {unit}, not mm", factor * a, factor * s
    for unit, factor in UNITS.items():
        yield f"s in {unit}, not mm", factor * s, a
        yield f"a in {unit}, not mm", s, factor * a
    if surface.period:
        yield "a as an angle in degrees, not mm", s, np.radians(1e3 * a) * surface.radius
        yield "a as an angle in rad, not mm", s, 1e3 * a * surface.radius
    yield "the sign of a changed", s, -a
    yield "the sign of s changed", -s, a
    yield "s from the other end of the link", surface.length - s, a
    yield "s from the other end of the link and the sign of a changed", surface.length - s, -a
    given = arm.on_board(p, s, a)
    for name, matrix in BOARD.items():
        yield name, *arm.on_link(p, given @ np.array(matrix, float).T)
    if placed.s or placed.a or placed.yaw:
        yield "places from the middle of the board, not on the link", *arm.on_link(p, np.stack([s, a], -1))
        yield (
            "places from the middle of the board, swapped, not on the link",
            *arm.on_link(p, np.stack([a, s], -1)),
        )


def _owner(table: PressTable, p: int, given: Floats) -> str:
    """Return whose place it is, where that is another patch's."""
    arm, middle = table.arm, np.median(given, axis=0)
    s, a = arm.on_link(p, middle[None])
    for q, placed in enumerate(arm.patches):
        if q != p and placed.link == arm.patches[p].link:
            there = arm.on_board(q, s, a)[0]
            if (np.abs(there) < 0.5 * np.array(placed.patch.size)).all():
                return f": the place of node {arm.node_label(q)}"
    return ""


def find_lags(given: Floats, read: Floats, pitch: float) -> Ints:
    """Return for each row how many rows further its readings stand, (n,); 0 where they are in place.

    given, read: (n, 2) m in the order of the file; NaN where the readings give no place.

    It is the sequence of lags of least cost: deviations, cut at a pitch, and a cost for each change.
    """
    n = len(given)
    lags = np.array([0, *(sign * k for k in range(1, LAGS + 1) for sign in (1, -1))])
    cost = np.full((n, len(lags)), 1.0)
    for column, lag in enumerate(lags):
        at = np.arange(n) + lag
        inside = np.flatnonzero((at >= 0) & (at < n))
        off = np.hypot(*(given[inside] - read[at[inside]]).T) / pitch
        cost[inside, column] = np.minimum(np.where(np.isfinite(off), off, 0.5), 1.0)
    total = cost[0].copy()
    came = np.zeros((n, len(lags)), np.intp)
    for i in range(1, n):
        cheapest = int(total.argmin())
        change = total[cheapest] + SWITCH < total
        came[i] = np.where(change, cheapest, np.arange(len(lags)))
        total = np.where(change, total[cheapest] + SWITCH, total) + cost[i]
    state = int(total.argmin())
    path = np.zeros(n, np.intp)
    for i in range(n - 1, -1, -1):
        path[i] = lags[state]
        state = int(came[i, state])
    return path
