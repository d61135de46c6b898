"""Silence where the neighbours of a tactel feel a touch: whether by their readings it should feel it too."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.judged_columns import Columns
from skinbus.estimate.kernels.neighbours import BEYOND, CLEAR, is_next, left_at
from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]
Tried = npt.NDArray[np.float32]

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
"""A tactel is silent below this part of what it should read at least, by so many standard deviations of
noise: every cycle of a touch is looked at."""


@inner_kernel
def look_for_silence(w: Columns, p: int, pressures: Floats, zero: Floats) -> None:
    """Look at one tactel of a touched board that reads nothing: should it?"""
    i0, size = w.start[p], w.start[p + 1] - w.start[p]
    for _ in range(size):
        w.turn[p] = (w.turn[p] + 1) % size
        i = i0 + w.turn[p]
        felt = pressures[i] - zero[i]
        if w.evident[i] or not w.healthy[i] or not felt < 3.0 * w.sigma[i]:
            continue
        beside = 0
        for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
            j = w.neighbour[e]
            if pressures[j] - zero[j] >= CLEAR * w.sigma[j] and is_next(w, e):
                beside += 1
        if beside >= 2:
            if is_less_than_around(w, p, i, pressures, zero):
                w.evident[i] = True
                w.felt_n[i] = 0
            return


@inner_kernel
def is_less_than_around(w: Columns, p: int, i: int, pressures: Floats, zero: Floats) -> bool:
    """Return whether a tactel reads less than any contact that explains its neighbours would press it."""
    most = max(pressures[i] - zero[i], 0.0) + NOISE * w.sigma[i]
    least = _least_felt(
        w, p, i, pressures, zero, w.tried, w.tried_row[i], w.own_row[p], COARSE_LIKELY, COARSE_MISFIT
    )
    if least <= CLEAR * w.sigma[i] or SILENT * least <= most:
        return False
    _fill_fine(w, p, i)
    least = _least_felt(w, p, i, pressures, zero, w.fine, 1, 0, LIKELY, MISFIT)
    return bool(least > CLEAR * w.sigma[i] and SILENT * least > most)


@inner_kernel
def _fill_fine(w: Columns, p: int, i: int) -> None:
    """Fill the fine places of one tactel; of the first row those of the tactel itself."""
    e0 = w.neighbour_start[i]
    for cell in range(FINE * FINE):
        x = (2.0 * (cell % FINE) / (FINE - 1) - 1.0) * SPAN
        y = (2.0 * (cell // FINE) / (FINE - 1) - 1.0) * SPAN
        w.fine[0, cell] = _tried_at(w, p, x, y)
        for e in range(e0, w.neighbour_start[i + 1]):
            w.fine[1 + e - e0, cell] = _tried_at(w, p, w.away[e, 0] - x, w.away[e, 1] - y)


@inner_kernel
def _tried_at(w: Columns, p: int, x: float, y: float) -> float:
    """Return what is left of the peak of a contact, in pitches from it; of cones the distance."""
    d = math.sqrt(x * x + y * y) / WIDTH
    return d if w.slope[p] > 0.0 else left_at(w, p, d)


@inner_kernel
def _least_felt(
    w: Columns,
    p: int,
    i: int,
    pressures: Floats,
    zero: Floats,
    tried: Tried,
    row: int,
    own: int,
    likely: float,
    misfit: float,
) -> float:
    """Return the least pressure (Pa) of a tactel under one contact that explains its neighbours, else 0.

    tried: what is left of the peak, by place of the contact, of the neighbours from ``row`` on, and of the
    tactel in row ``own``. Those with a chi^2 of at most ``likely`` more than the best explain the neighbours,
    if that of the best is at most ``misfit`` each.
    """
    up, down = w.up, w.down
    e0 = w.neighbour_start[i]
    slope, n_cells = w.slope[p], tried.shape[1]
    for cell in range(n_cells):
        up[cell] = down[cell] = 0.0
    n, top, square = 0, 0.0, 0.0
    for e in range(e0, w.neighbour_start[i + 1]):
        j, r = w.neighbour[e], row + e - e0
        reading = pressures[j] - zero[j]
        if w.fault[j] != 0 or not math.isfinite(reading) or pressures[j] >= w.high[j]:
            continue
        n += 1
        top = max(top, reading)
        square += reading * reading
        if slope == 0.0:
            for cell in range(n_cells):
                t = tried[r, cell]
                up[cell] += t * reading
                down[cell] += t * t
        elif reading > 6.0 * w.sigma[i]:
            for cell in range(n_cells):
                up[cell] += reading + slope * tried[r, cell]
                down[cell] += 1.0
    if n < 4:
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
                if w.fault[j] == 0 and math.isfinite(reading) and pressures[j] < w.high[j]:
                    chi2 += (reading - max(amplitude - slope * tried[row + e - e0, cell], 0.0)) ** 2
        if amplitude > BEYOND * w.high[i]:
            chi2 = math.inf
        up[cell], down[cell] = chi2, here
        best = min(best, chi2)
    scale = 1.0 / (w.sigma[i] ** 2 + (TOLERANCE * top) ** 2)
    if best * scale > misfit * n:
        return 0.0
    least = math.inf
    for cell in range(n_cells):
        if up[cell] * scale <= best * scale + likely:
            least = min(least, down[cell])
    return least
