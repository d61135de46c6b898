"""How unlikely it is that a reading comes again: by its noise, and by what its neighbours have changed by."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.judged_columns import Columns
from skinbus.estimate.kernels.neighbours import CLEAR, is_next
from skinbus.estimate.kernels.silence import is_less_than_around
from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]

SUSPECT: Final = math.log(1e-5)
"""Of a run of one tactel to be new samples, below which it is missing. One cycle in 10 000 of a contact of
ten tactels is IMPAIRED by it, and a tactel whose noise is 20 counts is missing after three repetitions."""
PROFILE_ERROR: Final = 0.3
"""Of the change of a neighbour's log, part of the mean change: no profile is quite Gaussian."""
SLOPE: Final = 1.0
"""Difference of these changes from one tactel to the next, part of the mean change, standard deviation."""
FELT: Final = 4.0
"""Standard deviations of noise of a reading whose ratio to the one before says something."""
FLOOR: Final = 2.0
"""Standard deviations of noise that a reading counts as at least, in a ratio."""


@inner_kernel
def note_repetition(w: Columns, p: int, i: int, pressures: Floats, zero: Floats) -> None:
    """Add a reading that has come again to the run of a tactel.

    The log of the ratio of two pressures is linear in the place, if a contact with a Gaussian profile moves
    and changes its force, whatever its width. So that of a tactel is what a plane through those of its
    neighbours says. Where it read nothing, the law of the board says whether it should by now.
    """
    if not (w.healthy[i] and w.low[i] < pressures[i] < w.high[i]):
        return
    chance = w.log_chance[i]
    if w.n_unused[p] == 0:  # what came last is of one sample
        if pressures[i] - zero[i] >= FELT * w.sigma[i]:
            chance += _log_chance_beside(w, i, pressures, zero)
        elif chance < 0.0 and _has_changed_beside(w, i, pressures, zero):
            chance += SUSPECT if is_less_than_around(w, p, i, pressures, zero) else 0.0
    # of noise that does not show, repetitions say nothing, and the largest change stands for the run
    w.run_chance[i] = w.run_chance[i] + chance if w.log_chance[i] < 0.0 else min(w.run_chance[i], chance)


@inner_kernel
def join_runs(w: Columns, p: int) -> None:
    """Take repetitions of tactels that follow each other as one: those of a PDO come together.

    What is missing teaches no rate of change.
    """
    begin, chance, size = w.start[p], 0.0, w.start[p + 1] - w.start[p]
    for i in range(w.start[p], w.start[p + 1] + 1):
        if i < w.start[p + 1] and w.log_chance[i] < 0.0:
            chance += w.run_chance[i]
            continue
        if i - begin > 1 and chance + math.log(size) < SUSPECT:
            for j in range(begin, i):
                w.run_chance[j] = min(w.run_chance[j], chance)
        begin, chance = i + 1, 0.0
    for i in range(w.start[p], w.start[p + 1]):
        w.is_old[i] |= w.run_chance[i] < SUSPECT


@inner_kernel
def _has_changed_beside(w: Columns, i: int, pressures: Floats, zero: Floats) -> bool:
    """Return whether two of the tactels next to one read a pressure, and one of them another than before."""
    n, has_changed = 0, False
    for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
        j = w.neighbour[e]
        if is_next(w, e) and pressures[j] - zero[j] >= CLEAR * w.sigma[j]:
            n += 1
            has_changed |= abs(pressures[j] - w.newest[j]) >= CLEAR * w.sigma[j]
    return n >= 2 and has_changed


@inner_kernel
def _log_chance_beside(w: Columns, i: int, pressures: Floats, zero: Floats) -> float:
    """Return by what factor the changes of its neighbours make a repetition less likely, as log."""
    n, s0, t2 = 0, 0.0, 0.0
    for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
        t, variance = _change(w, w.neighbour[e], pressures, zero)
        if variance > 0.0:
            n += 1
            s0 += 1.0 / variance
            t2 += t * t / variance
    if t2 <= n:
        return 0.0
    mean2 = (t2 - n) / s0  # square of the changes, less that of their noise
    s0, sx, sy, t0, tx, ty = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    sxx = syy = 1.0 / (SLOPE * SLOPE * mean2)
    sxy = 0.0
    for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
        t, variance = _change(w, w.neighbour[e], pressures, zero)
        if variance > 0.0:
            weight = 1.0 / (variance + PROFILE_ERROR * PROFILE_ERROR * mean2)
            x, y = w.away[e, 0], w.away[e, 1]
            s0 += weight
            sx += weight * x
            sy += weight * y
            sxx += weight * x * x
            sxy += weight * x * y
            syy += weight * y * y
            t0 += weight * t
            tx += weight * x * t
            ty += weight * y * t
    det = sxx * syy - sxy * sxy
    kx, ky = (syy * sx - sxy * sy) / det, (sxx * sy - sxy * sx) / det
    left = s0 - kx * sx - ky * sy
    change = (t0 - kx * tx - ky * ty) / left
    own = (2.0 * w.sigma[i] ** 2 + w.step[i] ** 2) / (pressures[i] - zero[i]) ** 2
    both = own + 1.0 / left
    return float(0.5 * (math.log(own / both) - change * change / both))


@inner_kernel
def _change(w: Columns, j: int, pressures: Floats, zero: Floats) -> tuple[float, float]:
    """Return the log of what a tactel reads, over what it read before, and its variance; 0 if not known."""
    before, now, least = w.newest[j] - zero[j], pressures[j] - zero[j], FLOOR * w.sigma[j]
    if w.fault[j] != 0 or pressures[j] == w.newest[j] or not max(before, now) >= CLEAR * w.sigma[j]:
        return 0.0, 0.0
    if not max(w.newest[j], pressures[j]) < w.high[j]:
        return 0.0, 0.0
    before, now = max(before, least), max(now, least)
    return math.log(now / before), w.sigma[j] ** 2 * (1.0 / before**2 + 1.0 / now**2)
