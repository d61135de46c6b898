"""A tactel among its neighbours by the law of its board: what it reads alone, and what it should have felt.

Contacts at places around a tactel are tried: what the law gives tactel and neighbours there is in tables made
once for each kind of board. Readings of a touch that stays where it is are averaged over some cycles: most
touches beside a corner of a board press its neighbours by little more than their noise.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Singles = npt.NDArray[np.float32]

DEAD: Final = 8
"""The bit of ``plausibility.TactelFault``."""
CLEAR: Final = 8.0
"""Standard deviations of noise: a prediction below proves nothing by its absence."""
PLACES, SPAN = 21, 1.75
"""Places of a contact that are tried along each axis, and how far they reach, in pitches. Any contact that is
felt beside a tactel, but not by it, is among them, and a reading changes by no more than the law's error from
one to the next."""
STEP: Final = 2.0 * SPAN / (PLACES - 1)
WIDTH, NARROW = 0.92, 0.8
"""Of a contact, part of that of the law: that of a tip of 2 mm is 0.8. By the one a tactel should have felt
something, by the other it reads alone."""
NEXT: Final = 1.5
"""Pitches: tactels nearer than this are next to each other."""

LONE: Final = 0.4
"""Of what the narrowest contact gives the neighbours of a tactel they read at least this part: gains differ
by 10 %, and the skirt of a tip of 2 mm is half of what the law, made so narrow, says."""
LONE_CORNER, CORNER_SIGMAS = 0.1, 4.0
"""The same of a press beyond a corner, of which less is felt; it must show in the noise."""
LONE_SURE: Final = 3.0
"""Standard deviations by which all neighbours together read less than that: what real contacts make them read
is 7 more, and once in a thousand cycles a tactel that only looks so is missing."""
BEYOND: Final = 4.0
"""Highest peak of a contact beside a tactel that is considered, in full scales: 170 N on the usual board."""
UNMOVED, MOVED = 4.0, 2.5
"""Change of a reading beside a jump, and of all beside it together, in standard deviations of noise, that
is none. A tip of 2 mm with 1 N in the middle of a tactel changes the four beside it by 2 each."""
JUMP_SIGMAS: Final = 12.0
"""A jump, in standard deviations of noise, and at least the touch threshold: twice what is a touch."""

LIKELY, MISFIT, TOLERANCE = 6.0, 1.0, 0.1
"""chi^2 within which another place explains the neighbours too; chi^2 of each neighbour beyond which none
does; the law's error, part of the peak."""
WINDOW, LEAST_WINDOW = 8, 4
"""Cycles that are averaged, at most, and at least: a tap of 0.1 s at 50 Hz has so many."""
STEADY, STEADY_SIGMAS = 0.25, 6.0
"""A touch stays where it is while no reading changes by more than this part of the highest, and noise."""
LEAST_NOISE = 0.35
"""Of a mean, part of the noise of one reading: zeros are not known better."""
EVIDENT_TOUCHES, ELSEWHERE = 2, 0.35
"""Touches in a row that a dead tactel should have felt, and pitches from the first: that may be two contacts
that look like one, and press the same place again and again."""
DEAD_SHARE, SURE = 0.1, 4.0
"""A dead tactel reads less than this part of the least it should have, by so many standard deviations: beside
a tip of 2 mm, for which the law is too wide, a healthy one may read a tenth."""
NONE, ALONG_U, ALONG_V = range(3)
"""Neighbours that may be dead too: none, those of the same v, of the same u. A row is dead with its wire."""
IN_LINE = 0.25
"""Pitches off a line by which a tactel is in it."""
BACK_READINGS = 10
"""Readings of a pressure after which a dead tactel is not."""
FEELS: Final = 5.0
"""Standard deviations of a mean from which a tactel feels something: it lives."""


class Columns(NamedTuple):
    """What the judgement keeps from cycle to cycle: columns per tactel (n,) and per patch (p,)."""

    start: Ints  # (p + 1,)
    healthy: Bools
    high: Floats  # Pa, full scale
    low: Floats  # Pa, the lower end
    sigma: Floats  # Pa, with the rounding of the counts
    touch: Floats  # Pa
    neighbour_start: Ints  # (n + 1,) of the same board
    neighbour: Ints
    away: Floats  # (m, 2) pitches, from the tactel to each neighbour
    is_next: Bools  # (m,) whether it is one step away: on a square, the diagonals too
    wide: Singles  # (rows, PLACES^2) part of the peak of a contact at a place that a tactel feels
    narrow: Singles  # the same of the narrowest contact
    tried_row: Ints  # (n,) row of the first neighbour of each tactel
    own_row: Ints  # (p,) row of the tactel itself
    up: Floats  # scratch, by place
    down: Floats
    fault: npt.NDArray[np.uint8]  # (n,)
    last: Floats  # Pa, as it came last
    change: Floats  # Pa, since then; infinite at first
    still: Ints  # readings in a row without change
    is_old: Bools  # so unlikely to be new, with what neighbours say, that it is missing
    was_old: Bools  # some reading of this run is known not to be new
    quiet: Floats  # log of the largest chance of a reading to come again, by the declared noise
    cycles: Floats  # while free, of the rate of change
    changes: Floats
    rail_n: Ints  # readings in a row at a rail, or alone
    lone_n: Ints  # readings in a row alone at full scale
    before: Floats  # the reading before a jump
    jump_age: Ints  # cycles since it
    jumps: Floats
    good_s: Floats  # since it was implausible last
    mean: Floats  # Pa, of a touch that stays where it is
    evident: Bools  # should have felt something in this touch
    touches: Ints  # in a row that it should have felt and has not
    due: Floats  # sum of the square of what it should have read at least, in noise
    shown: Floats  # the same of that times what it read
    first_cell: Ints  # place of the first touch that it should have felt
    felt_n: Ints
    window_n: Ints  # (p,) cycles in ``mean``
    turn: Ints  # (p,) the next tactel to look at
    quiet_s: Floats  # (p,) since the board was touched
    is_full: Bools  # (p,) all readings of the board are at full scale, and came there at once
    is_crushed: Bools  # (p,) half of its readings were in the upper half of their range before
    is_repeated: Bools  # (p,) its readings are too unlikely to be new
    is_withheld: Bools  # (p,) one of these
    n_faulty: Ints  # (p,)


@inner_kernel
def is_alone(w: Columns, p: int, i: int, pressures: Floats, zero: Floats) -> bool:
    """Return whether a tactel reads what no contact around explains: its neighbours would read more."""
    felt = min(pressures[i], w.high[i]) - zero[i]
    if pressures[i] >= w.high[i] and _is_lone_beyond_corner(w, i, pressures, zero, felt):
        return True
    if felt < max(w.touch[i], JUMP_SIGMAS * w.sigma[i]):
        return False
    n_cells = w.narrow.shape[1]
    if not _is_more_than_beside(w, i, pressures, zero, felt, n_cells // 2):
        return False
    for cell in range(n_cells):
        peak = felt / max(w.narrow[w.own_row[p], cell], 1e-9)
        if peak <= BEYOND * w.high[i] and not _is_more_than_beside(w, i, pressures, zero, peak, cell):
            return False
    return True


@inner_kernel
def _is_more_than_beside(w: Columns, i: int, pressures: Floats, zero: Floats, peak: float, cell: int) -> bool:
    """Return whether the neighbours of a tactel read too little for a contact at a place, peak in Pa."""
    less, square, n, e0 = 0.0, 0.0, 0, w.neighbour_start[i]
    for e in range(e0, w.neighbour_start[i + 1]):
        j = w.neighbour[e]
        if w.fault[j] == 0 and math.isfinite(pressures[j]):
            law = peak * w.narrow[w.tried_row[i] + e - e0, cell]
            # what is more than the law may be of another contact, and makes up for no other neighbour
            less += law * (LONE * law - min(max(pressures[j] - zero[j], 0.0), law))
            square += (law * w.sigma[j]) ** 2
            n += 1
    return bool(n >= 2 and square > 0.0 and less >= LONE_SURE * math.sqrt(square))


@inner_kernel
def _is_lone_beyond_corner(w: Columns, i: int, pressures: Floats, zero: Floats, felt: float) -> bool:
    """Return whether none next to a tactel at full scale reads a part of what a press on it would give them.

    Beyond a corner of the board a press may be that gives its neighbours little.
    """
    n, e0 = 0, w.neighbour_start[i]
    for e in range(e0, w.neighbour_start[i + 1]):
        j = w.neighbour[e]
        if w.fault[j] == 0 and math.isfinite(pressures[j]) and w.is_next[e]:
            least = LONE_CORNER * felt * w.narrow[w.tried_row[i] + e - e0, w.narrow.shape[1] // 2]
            # where so little is lost in the noise, its absence proves nothing
            if least <= CORNER_SIGMAS * w.sigma[i] or pressures[j] - zero[j] >= least:
                return False
            n += 1
    return n >= 2


@inner_kernel
def jumps_alone(w: Columns, i: int) -> bool:
    """Return whether the nearest neighbours of a tactel stay as they were while it changes, by ``change``.

    A tap changes them too, each or all together, however narrow and short it is.
    """
    n, total, square = 0, 0.0, 0.0
    for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
        j = w.neighbour[e]
        if w.fault[j] != 0 or not math.isfinite(w.change[j]) or not w.is_next[e]:
            continue
        n += 1
        change, variance = w.change[j], 2.0 * w.sigma[j] * w.sigma[j]
        total += change if w.change[i] > 0.0 else -change
        square += variance
        if change * change >= UNMOVED * UNMOVED * variance:
            return False
    return n >= 2 and total < MOVED * math.sqrt(square)


@inner_kernel
def watch_touch(w: Columns, p: int, pressures: Floats, zero: Floats, is_touched: bool) -> None:
    """Average the readings of a board while a touch stays where it is; look at one of its silent tactels."""
    i0, i1 = w.start[p], w.start[p + 1]
    if is_touched:
        top, is_steady = 0.0, True
        for i in range(i0, i1):
            top = max(top, pressures[i] - zero[i])
        for i in range(i0, i1):
            change = abs(pressures[i] - zero[i] - w.mean[i])
            is_steady &= not change > STEADY * top + STEADY_SIGMAS * w.sigma[i]
        if not is_steady or w.turn[p] >= i1:
            w.window_n[p], w.turn[p] = 0, i0
        if w.window_n[p] < WINDOW:
            w.window_n[p] += 1
            for i in range(i0, i1):
                felt = pressures[i] - zero[i] if pressures[i] < w.high[i] else math.nan
                w.mean[i] = felt if w.window_n[p] == 1 else w.mean[i] + (felt - w.mean[i]) / w.window_n[p]
    n = w.window_n[p]
    if n < (WINDOW if is_touched else LEAST_WINDOW):
        return
    shrink = max(1.0 / math.sqrt(n), LEAST_NOISE)
    while w.turn[p] < i1:
        i = w.turn[p]
        w.turn[p] += 1
        if w.healthy[i] and w.mean[i] >= FEELS * shrink * w.sigma[i]:
            note_life(w, i, n)
        elif w.healthy[i] and math.isfinite(w.mean[i]) and _is_silent(w, p, i, n, shrink):
            return  # one that is looked at in a cycle


@inner_kernel
def _is_silent(w: Columns, p: int, i: int, n: int, shrink: float) -> bool:
    """Look whether a tactel that reads nothing should; return False if too little is felt beside it."""
    beside = 0
    for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
        j = w.neighbour[e]
        beside += w.is_next[e] and w.mean[j] >= CLEAR * shrink * w.sigma[j]
    if beside < 2:
        return False
    least, cell = 0.0, 0
    for dead in (NONE, ALONG_U, ALONG_V):
        if least == 0.0:
            least, cell = _least_felt(w, p, i, shrink * w.sigma[i], dead)
    if w.touches[i] == 0 and not w.evident[i]:
        w.first_cell[i] = cell
    u = cell % PLACES - w.first_cell[i] % PLACES
    v = cell // PLACES - w.first_cell[i] // PLACES
    # the first touch that it has not felt may be two contacts that look like one, and come again and again
    is_elsewhere = STEP * math.sqrt(u * u + v * v) >= ELSEWHERE or w.touches[i] == 0
    if least > CLEAR * shrink * w.sigma[i] and is_elsewhere:
        least /= w.sigma[i]
        w.due[i] += n * least * least
        w.shown[i] += n * least * w.mean[i] / w.sigma[i]
        w.evident[i] = True
        w.felt_n[i] = 0
    return True


@inner_kernel
def note_life(w: Columns, i: int, n: int) -> None:
    """Note that a tactel felt something in n readings."""
    w.evident[i] = False
    w.due[i] = w.shown[i] = 0.0
    w.felt_n[i] += n
    if w.fault[i] & DEAD == 0 or w.felt_n[i] >= BACK_READINGS:
        w.touches[i] = 0
        w.fault[i] &= ~np.uint8(DEAD)


@inner_kernel
def end_touch(w: Columns, p: int) -> None:
    """Name the tactels of a board that read too little of what they should have in some touches."""
    w.window_n[p], w.turn[p] = 0, w.start[p]
    for i in range(w.start[p], w.start[p + 1]):
        if not w.evident[i]:
            continue
        w.evident[i] = False
        w.touches[i] += 1
        is_silent = w.shown[i] + SURE * math.sqrt(w.due[i]) < DEAD_SHARE * w.due[i]
        if is_silent and w.touches[i] >= EVIDENT_TOUCHES:
            w.fault[i] |= DEAD


@inner_kernel
def _least_felt(w: Columns, p: int, i: int, sigma: float, dead: int) -> tuple[float, int]:
    """Return the least mean (Pa) of a tactel under one contact that explains its neighbours, and its place.

    sigma: of the noise of their means, Pa.
    dead:  which of its neighbours count as missing where they read nothing: those of its row, or column

    Of the places of a contact those with a chi^2 of at most LIKELY more than the best explain the neighbours,
    if that of the best is at most MISFIT each. 0 if none does, or the board reads more elsewhere.
    """
    up, down, e0, n_cells = w.up, w.down, w.neighbour_start[i], w.wide.shape[1]
    for cell in range(n_cells):
        up[cell] = down[cell] = 0.0
    n, top, square = 0, 0.0, 0.0
    for e in range(e0, w.neighbour_start[i + 1]):
        j, row = w.neighbour[e], w.tried_row[i] + e - e0
        reading = w.mean[j]
        is_in_line = dead != NONE and abs(w.away[e, 2 - dead]) < IN_LINE
        if w.fault[j] != 0 or not math.isfinite(reading) or (is_in_line and reading < CLEAR * sigma):
            continue
        n += 1
        top = max(top, reading)
        square += reading * reading
        for cell in range(n_cells):
            t = w.wide[row, cell]
            up[cell] += t * reading
            down[cell] += t * t
    for j in range(w.start[p], w.start[p + 1]):
        if n < 4 or (w.fault[j] == 0 and w.mean[j] > top):
            return 0.0, 0
    best, place, own = math.inf, 0, w.own_row[p]
    for cell in range(n_cells):
        amplitude = up[cell] / down[cell] if down[cell] > 0.0 else 0.0
        up[cell] = square - amplitude * up[cell] if amplitude <= BEYOND * w.high[i] else math.inf
        down[cell] = amplitude * w.wide[own, cell]
        if up[cell] < best:
            best, place = up[cell], cell
    scale = 1.0 / (sigma**2 + (TOLERANCE * top) ** 2)
    least = math.inf if best * scale <= MISFIT * n else 0.0
    for cell in range(n_cells):
        if up[cell] * scale <= best * scale + LIKELY:
            least = min(least, down[cell])
    return least, place
