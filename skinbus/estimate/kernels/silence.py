"""A tactel among its neighbours by the law of its board: what it reads alone, and what it should have felt.

Contacts at places around a tactel are tried: what the law gives tactel and neighbours there is in tables made
once for each kind of board. Readings of a touch that stays where it is are averaged over a window of some
cycles: most touches beside a corner of a board press its neighbours by little more than their noise.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.judged_columns import Columns
from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]

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
JUMP_SHARE: Final = 0.5
"""Of full scale: by less a tactel may come to full scale with its neighbours unchanged, under a force that
grows."""
UNMOVED, MOVED = 4.0, 2.5
"""Change of a reading beside a jump, and of all beside it together, in standard deviations of noise, that
is none. A tip of 2 mm with 1 N in the middle of a tactel changes the four beside it by 2 each."""
JUMP_SIGMAS: Final = 12.0
"""A jump, in standard deviations of noise, and at least the touch threshold: twice what is a touch."""

LIKELY, MISFIT, TOLERANCE = 6.0, 1.0, 0.1
"""chi^2 within which another place explains the neighbours too; chi^2 of each neighbour beyond which none
does; the law's error, part of the peak."""
WINDOW, LEAST_WINDOW = 8, 4
"""Cycles that are averaged, at most and at least: a tap of 0.1 s at 50 Hz has one window."""
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


@inner_kernel
def is_alone(w: Columns, p: int, i: int, pressures: Floats, zero: Floats) -> bool:
    """Return whether a tactel reads what no contact around explains: its neighbours would read more."""
    felt = min(pressures[i], w.high[i]) - zero[i]
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
def is_lone_at_full_scale(w: Columns, p: int, i: int, pressures: Floats, zero: Floats) -> bool:
    """Return whether a tactel is at full scale and none next to it reads what a press on it would give them.

    Beyond a corner of the board a press may be that gives its neighbours little: there this names what
    :func:`is_alone` leaves open.
    """
    # where a tenth of that is lost in the noise, its absence proves nothing
    least, n = LONE_CORNER * w.beside[p] * (w.high[i] - zero[i]), 0
    if pressures[i] < w.high[i] or least <= CORNER_SIGMAS * w.sigma[i]:
        return False
    for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
        j = w.neighbour[e]
        if w.fault[j] == 0 and math.isfinite(pressures[j]) and w.is_next[e]:
            if pressures[j] - zero[j] >= least:
                return False
            n += 1
    return n >= 2


@inner_kernel
def came_alone(w: Columns, p: int, i: int, pressures: Floats) -> bool:
    """Return whether a tactel came to full scale in one reading while its neighbours stayed as they were.

    A finger that presses or moves there changes them, up or down.
    """
    if not pressures[i] - w.last[i] >= JUMP_SHARE * w.high[i]:
        return False
    w.change[i] = pressures[i] - w.last[i]
    for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
        j = w.neighbour[e]
        w.change[j] = abs(pressures[j] - w.last[j])
    return is_alone(w, p, i, w.change, w.nothing)


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
    n = w.window_n[p]
    if n > 0:
        top = 0.0
        for i in range(i0, i1):
            top = max(top, pressures[i] - zero[i])
        is_steady = is_touched
        for i in range(i0, i1):
            change = abs(pressures[i] - w.window_first[i])
            is_steady &= not change > STEADY * top + STEADY_SIGMAS * w.sigma[i]
        if n == WINDOW or not is_steady:
            if n >= LEAST_WINDOW:
                for i in range(i0, i1):
                    w.mean[i] = w.window_sum[i] / n
                w.mean_n[p] = n
                w.turn[p] = i0
            n = 0
    if is_touched:
        for i in range(i0, i1):
            felt = pressures[i] - zero[i] if pressures[i] < w.high[i] else math.nan
            if n == 0:
                w.window_first[i] = pressures[i]
                w.window_sum[i] = 0.0
            w.window_sum[i] += felt
        n += 1
    w.window_n[p] = n
    if w.mean_n[p] > 0:
        _look_for_silence(w, p)


@inner_kernel
def _look_for_silence(w: Columns, p: int) -> None:
    """Look at the next tactel that reads nothing in a window: should it?"""
    n = w.mean_n[p]
    shrink = max(1.0 / math.sqrt(n), LEAST_NOISE)
    while w.turn[p] < w.start[p + 1]:
        i = w.turn[p]
        w.turn[p] += 1
        sigma, felt = shrink * w.sigma[i], w.mean[i]
        if not (w.healthy[i] and math.isfinite(felt)):
            continue
        if felt >= FEELS * sigma:
            note_life(w, i, n)
            continue
        beside = 0
        for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
            j = w.neighbour[e]
            if w.mean[j] >= CLEAR * shrink * w.sigma[j] and w.is_next[e]:
                beside += 1
        if beside >= 2:
            least = 0.0
            for dead in (NONE, ALONG_U, ALONG_V):
                if least == 0.0:
                    least = _least_felt(w, p, i, sigma, dead)
            if least > CLEAR * sigma and _is_elsewhere(w, i):
                least /= w.sigma[i]
                w.due[i] += n * least * least
                w.shown[i] += n * least * felt / w.sigma[i]
                w.evident[i] = True
                w.felt_n[i] = 0
            return
    w.mean_n[p] = 0


@inner_kernel
def _is_elsewhere(w: Columns, i: int) -> bool:
    """Return whether the contact found is not where the first touch was that a tactel has not felt."""
    x, y = w.best[0] % PLACES * STEP, w.best[0] // PLACES * STEP
    if w.touches[i] == 0 and not w.evident[i]:
        w.where[i, 0], w.where[i, 1] = x, y
    is_first = w.touches[i] == 0
    away2 = (x - w.where[i, 0]) ** 2 + (y - w.where[i, 1]) ** 2
    return bool(is_first or away2 >= ELSEWHERE * ELSEWHERE)


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
    w.mean_n[p] = 0
    for i in range(w.start[p], w.start[p + 1]):
        if not w.evident[i]:
            continue
        w.evident[i] = False
        w.touches[i] += 1
        is_silent = w.shown[i] + SURE * math.sqrt(w.due[i]) < DEAD_SHARE * w.due[i]
        if is_silent and w.touches[i] >= EVIDENT_TOUCHES:
            w.fault[i] |= DEAD


@inner_kernel
def _least_felt(w: Columns, p: int, i: int, sigma: float, dead: int) -> float:
    """Return the least mean (Pa) of a tactel under one contact that explains its neighbours, else 0.

    sigma: of the noise of their means, Pa.
    dead:  which of its neighbours count as missing where they read nothing: those of its row, or column

    Of the places of a contact those with a chi^2 of at most LIKELY more than the best explain the neighbours,
    if that of the best is at most MISFIT each.
    """
    up, down, e0, n_cells = w.up, w.down, w.neighbour_start[i], w.wide.shape[1]
    for cell in range(n_cells):
        up[cell] = down[cell] = 0.0
    n, top, square, lacks = 0, 0.0, 0.0, False
    for e in range(e0, w.neighbour_start[i + 1]):
        j, row = w.neighbour[e], w.tried_row[i] + e - e0
        reading = w.mean[j]
        is_in_line = dead != NONE and abs(w.away[e, 2 - dead]) < IN_LINE
        lacks |= w.fault[j] != 0 or is_in_line
        is_missing = is_in_line and reading < CLEAR * sigma
        if dead != NONE and w.fault[j] != 0 and not is_missing:
            return 0.0
        if is_missing or w.fault[j] != 0 or not math.isfinite(reading):
            continue
        n += 1
        top = max(top, reading)
        square += reading * reading
        for cell in range(n_cells):
            t = w.wide[row, cell]
            up[cell] += t * reading
            down[cell] += t * t
    for j in range(w.start[p], w.start[p + 1]):
        # past a dead one a touch may be where the board reads more
        if n < 4 or (lacks and w.fault[j] == 0 and w.mean[j] > top):
            return 0.0
    best, own = math.inf, w.own_row[p]
    for cell in range(n_cells):
        amplitude = up[cell] / down[cell] if down[cell] > 0.0 else 0.0
        chi2 = square - amplitude * up[cell] if amplitude <= BEYOND * w.high[i] else math.inf
        up[cell], down[cell] = chi2, amplitude * w.wide[own, cell]
        if chi2 < best:
            best = chi2
            w.best[0] = cell
    scale = 1.0 / (sigma**2 + (TOLERANCE * top) ** 2)
    if best * scale > MISFIT * n:
        return 0.0
    least = math.inf
    for cell in range(n_cells):
        if up[cell] * scale <= best * scale + LIKELY:
            least = min(least, down[cell])
    return least
