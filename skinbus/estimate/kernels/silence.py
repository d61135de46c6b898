"""Silence where the neighbours of a tactel feel a touch: whether by their readings it should feel it too.

Readings of a touch that stays where it is are averaged over a window of some cycles: most touches beside a
corner of a board press its neighbours by little more than their noise.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.judged_columns import Columns
from skinbus.estimate.kernels.neighbours import BEYOND, CLEAR, is_next, left_at
from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]
Tried = npt.NDArray[np.float32]

DEAD: Final = 8
"""The bit of ``plausibility.TactelFault``."""

LIKELY, MISFIT, TOLERANCE = 6.0, 1.0, 0.1
"""chi^2 within which another place explains the neighbours too; chi^2 of each neighbour beyond which none
does; the law's error, part of the peak."""
COARSE_LIKELY, COARSE_MISFIT = 1.0, 4.0
"""The same of coarse places, which only decide whether fine ones are tried."""
PLACES, FINE, SPAN = 11, 21, 1.75
"""Places of a contact that are tried along each axis, and that are tried before a tactel is said to be
silent; how far they reach, in pitches. Any contact that is felt beside the tactel, but not by it, is among
them, and a reading changes by no more than the law's error from one of the fine ones to the next."""
WIDTH = 0.9
"""Of a contact, part of that of the law: that of a tip of 2 mm is 0.8."""
SILENT, NOISE = 0.5, 2.5
"""A tactel is silent in one cycle below this part of what it should read at least, by so many standard
deviations of noise."""
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
FEELS = 5.0
"""Standard deviations of a mean from which a tactel feels something: it lives."""


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
            if w.mean[j] >= CLEAR * shrink * w.sigma[j] and is_next(w, e):
                beside += 1
        if beside >= 2:
            least = 0.0
            for dead in (NONE, ALONG_U, ALONG_V):
                if least == 0.0:
                    least = least_felt(w, p, i, w.mean, w.nothing, sigma, dead)
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
    x, y = _place(w.best[0])
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
def is_less_than_around(w: Columns, p: int, i: int, pressures: Floats, zero: Floats) -> bool:
    """Return whether a tactel reads less than any contact that explains its neighbours would press it."""
    most = max(pressures[i] - zero[i], 0.0) + NOISE * w.sigma[i]
    least = least_felt(w, p, i, pressures, zero, w.sigma[i], NONE)
    return bool(least > CLEAR * w.sigma[i] and SILENT * least > most)


@inner_kernel
def least_felt(w: Columns, p: int, i: int, pressures: Floats, zero: Floats, sigma: float, dead: int) -> float:
    """Return the least pressure (Pa) of a tactel under one contact that explains its neighbours, else 0.

    sigma: of the noise of their readings, Pa.
    dead:  which of its neighbours count as missing where they read nothing: those of its row, or column
    """
    coarse, misfit, row = COARSE_LIKELY, COARSE_MISFIT, w.tried_row[i]
    least = _least_felt(w, p, i, pressures, zero, sigma, dead, w.tried, row, w.own_row[p], coarse, misfit)
    if least <= CLEAR * sigma:
        return 0.0
    _fill_fine(w, p, i)
    return _least_felt(w, p, i, pressures, zero, sigma, dead, w.fine, 1, 0, LIKELY, MISFIT)


@inner_kernel
def _fill_fine(w: Columns, p: int, i: int) -> None:
    """Fill the fine places of one tactel; of the first row those of the tactel itself."""
    e0 = w.neighbour_start[i]
    for cell in range(FINE * FINE):
        x, y = _place(cell)
        w.fine[0, cell] = _tried_at(w, p, x, y)
        for e in range(e0, w.neighbour_start[i + 1]):
            w.fine[1 + e - e0, cell] = _tried_at(w, p, w.away[e, 0] - x, w.away[e, 1] - y)


@inner_kernel
def _place(cell: int) -> tuple[float, float]:
    """Return where a fine place is, in pitches from the tactel."""
    return (
        (2.0 * (cell % FINE) / (FINE - 1) - 1.0) * SPAN,
        (2.0 * (cell // FINE) / (FINE - 1) - 1.0) * SPAN,
    )


@inner_kernel
def _tried_at(w: Columns, p: int, x: float, y: float) -> float:
    """Return what is left of the peak of a contact, in pitches from it; of cones the distance."""
    d = math.sqrt(x * x + y * y) / WIDTH
    return d if w.slope[p] > 0.0 else left_at(w, p, d)


@inner_kernel
def _is_more_elsewhere(w: Columns, p: int, pressures: Floats, zero: Floats, top: float) -> bool:
    """Return whether a tactel of a board reads more than ``top``: past a dead one a touch may be there."""
    more = False
    for j in range(w.start[p], w.start[p + 1]):
        more |= w.fault[j] == 0 and pressures[j] - zero[j] > top
    return more


@inner_kernel
def _least_felt(
    w: Columns,
    p: int,
    i: int,
    pressures: Floats,
    zero: Floats,
    sigma: float,
    dead: int,
    tried: Tried,
    row: int,
    own: int,
    likely: float,
    misfit: float,
) -> float:
    """Return what :func:`least_felt` does, for places of a contact that are tried.

    tried: what is left of the peak, by place of the contact, of the neighbours from ``row`` on, and of the
    tactel in row ``own``. Those with a chi^2 of at most ``likely`` more than the best explain the neighbours,
    if that of the best is at most ``misfit`` each.
    """
    up, down = w.up, w.down
    e0 = w.neighbour_start[i]
    slope, n_cells = w.slope[p], tried.shape[1]
    for cell in range(n_cells):
        up[cell] = down[cell] = 0.0
    n, top, square, lacks = 0, 0.0, 0.0, False
    for e in range(e0, w.neighbour_start[i + 1]):
        j, r = w.neighbour[e], row + e - e0
        reading = pressures[j] - zero[j]
        w.counts[e] = w.fault[j] == 0 and math.isfinite(reading) and pressures[j] < w.high[j]
        is_in_line = dead != NONE and abs(w.away[e, 2 - dead]) < IN_LINE
        lacks |= w.fault[j] != 0 or is_in_line
        if is_in_line and reading < CLEAR * sigma:
            w.counts[e] = False
        elif dead != NONE and w.fault[j] != 0:
            return 0.0
        if not w.counts[e]:
            continue
        n += 1
        top = max(top, reading)
        square += reading * reading
        if slope == 0.0:
            for cell in range(n_cells):
                t = tried[r, cell]
                up[cell] += t * reading
                down[cell] += t * t
        elif reading > 6.0 * sigma:
            for cell in range(n_cells):
                up[cell] += reading + slope * tried[r, cell]
                down[cell] += 1.0
    if n < 4 or (lacks and _is_more_elsewhere(w, p, pressures, zero, top)):
        return 0.0
    best = math.inf
    for cell in range(n_cells):
        amplitude = up[cell] / down[cell] if down[cell] > 0.0 else 0.0
        if slope == 0.0:
            chi2, here = square - amplitude * up[cell], amplitude * tried[own, cell]
        else:
            chi2, here = 0.0, max(amplitude - slope * tried[own, cell], 0.0)
            for e in range(e0, w.neighbour_start[i + 1]):
                j = w.neighbour[e]
                reading = pressures[j] - zero[j]
                if w.counts[e]:
                    chi2 += (reading - max(amplitude - slope * tried[row + e - e0, cell], 0.0)) ** 2
        if amplitude > BEYOND * w.high[i]:
            chi2 = math.inf
        up[cell], down[cell] = chi2, here
        if chi2 < best:
            best = chi2
            w.best[0] = cell
    scale = 1.0 / (sigma**2 + (TOLERANCE * top) ** 2)
    if best * scale > misfit * n:
        return 0.0
    least = math.inf
    for cell in range(n_cells):
        if up[cell] * scale <= best * scale + likely:
            least = min(least, down[cell])
    return least
