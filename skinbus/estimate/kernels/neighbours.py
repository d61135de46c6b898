"""A tactel among its neighbours: what the law of a board gives them, and whether one reads what it cannot."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.judged_columns import Columns
from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]

CLEAR: Final = 8.0
"""Standard deviations of noise: a prediction below proves nothing by its absence."""
NARROW: Final = 0.8
"""Width of the narrowest contact, part of that of the law: a tip of 2 mm on the usual board."""
LONE: Final = 0.4
"""Of what the narrowest contact gives the neighbours of a tactel they read at least this part: gains differ
by 10 %, and the skirt of a tip of 2 mm is half of what the law, made so narrow, says."""
LONE_CORNER, CORNER_SIGMAS = 0.1, 4.0
"""The same of a press beyond a corner, of which less is felt; it must show in the noise."""
SURE: Final = 3.0
"""Standard deviations by which all neighbours together read less than that: what real contacts make them read
is 7 more, and once in a thousand cycles a tactel that only looks so is missing."""
BEYOND: Final = 4.0
"""Highest peak of a contact beside a tactel that is considered, in full scales: 170 N on the usual board."""
GRID, SPAN = 9, 1.4
"""Places of a contact that are tried along each axis, and how far they reach, in pitches: 0.35 pitches apart,
and any that is felt beside the tactel but not by it is among them."""
PROFILE, PROFILE_SPAN = 32, 4.0
"""Points of a law's profile, and how far it reaches, in pitches."""
NEXT: Final = 1.5
"""Pitches: tactels nearer than this are next to each other."""
JUMP_SHARE: Final = 0.5
"""Of full scale: by less a tactel may come to full scale with its neighbours unchanged, under a force that
grows."""
UNMOVED, MOVED = 4.0, 2.5
"""Change of a reading beside a jump, and of all beside it together, in standard deviations of noise, that
is none. A tip of 2 mm with 1 N in the middle of a tactel changes the four beside it by 2 each."""
JUMP_SIGMAS: Final = 12.0
"""A jump, in standard deviations of noise, and at least the touch threshold: twice what is a touch."""


@inner_kernel
def is_alone(w: Columns, p: int, i: int, pressures: Floats, zero: Floats) -> bool:
    """Return whether a tactel reads what no contact around explains: its neighbours would read more."""
    felt = min(pressures[i], w.high[i]) - zero[i]
    if felt < max(w.touch[i], JUMP_SIGMAS * w.sigma[i]):
        return False
    if not _is_more_than_beside(w, p, i, pressures, zero, felt, 0.0, 0.0):
        return False
    for cell in range(GRID * GRID):
        x = (2.0 * (cell % GRID) / (GRID - 1) - 1.0) * SPAN
        y = (2.0 * (cell // GRID) / (GRID - 1) - 1.0) * SPAN
        t = share(w, p, math.sqrt(x * x + y * y))
        peak = felt + t if w.slope[p] > 0.0 else felt / max(t, 1e-9)
        if peak <= BEYOND * w.high[i] and not _is_more_than_beside(w, p, i, pressures, zero, peak, x, y):
            return False
    return True


@inner_kernel
def _is_more_than_beside(
    w: Columns, p: int, i: int, pressures: Floats, zero: Floats, peak: float, x: float, y: float
) -> bool:
    """Return whether the neighbours of a tactel read too little for a contact beside it, peak in Pa."""
    less, square, n = 0.0, 0.0, 0
    for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
        j = w.neighbour[e]
        if w.fault[j] != 0 or not math.isfinite(pressures[j]):
            continue
        dx, dy = w.away[e, 0] - x, w.away[e, 1] - y
        t = share(w, p, math.sqrt(dx * dx + dy * dy))
        law = max(peak - t, 0.0) if w.slope[p] > 0.0 else peak * t
        # what is more than the law may be of another contact, and makes up for no other neighbour
        less += law * (LONE * law - min(max(pressures[j] - zero[j], 0.0), law))
        square += (law * w.sigma[j]) ** 2
        n += 1
    return bool(n >= 2 and square > 0.0 and less >= SURE * math.sqrt(square))


@inner_kernel
def is_lone_at_full_scale(w: Columns, p: int, i: int, pressures: Floats, zero: Floats) -> bool:
    """Return whether a tactel is at full scale and none next to it reads what a press on it would give them.

    Beyond a corner of the board a press may be that gives its neighbours little: there this names what
    :func:`is_alone` leaves open.
    """
    if pressures[i] < w.high[i]:
        return False
    full = w.high[i] - zero[i]
    beside = max(full - share(w, p, 1.0), 0.0) if w.slope[p] > 0.0 else full * share(w, p, 1.0)
    # where a tenth of that is lost in the noise, its absence proves nothing
    least = LONE_CORNER * beside
    return least > CORNER_SIGMAS * w.sigma[i] and is_lone(w, i, pressures, zero, least)


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
        if w.fault[j] != 0 or not math.isfinite(w.change[j]) or not is_next(w, e):
            continue
        n += 1
        change, variance = w.change[j], 2.0 * w.sigma[j] * w.sigma[j]
        total += change if w.change[i] > 0.0 else -change
        square += variance
        if change * change >= UNMOVED * UNMOVED * variance:
            return False
    return n >= 2 and total < MOVED * math.sqrt(square)


@inner_kernel
def is_lone(w: Columns, i: int, pressures: Floats, zero: Floats, least: float) -> bool:
    """Return whether the nearest neighbours of a tactel, those that can be read, are below ``least`` (Pa)."""
    n = 0
    for e in range(w.neighbour_start[i], w.neighbour_start[i + 1]):
        j = w.neighbour[e]
        if w.fault[j] != 0 or not math.isfinite(pressures[j]) or not is_next(w, e):
            continue
        if pressures[j] - zero[j] >= least:
            return False
        n += 1
    return n >= 2


@inner_kernel
def is_next(w: Columns, e: int) -> bool:
    """Return whether a neighbour is one step away: on a square, the diagonals too."""
    return bool(w.away[e, 0] ** 2 + w.away[e, 1] ** 2 < NEXT * NEXT)


@inner_kernel
def share(w: Columns, p: int, d: float) -> float:
    """Return what is left of the peak d pitches off the narrowest contact, or of a cone what is lost (Pa)."""
    if w.slope[p] > 0.0:
        return float(w.slope[p] * d)
    return left_at(w, p, d / NARROW)


@inner_kernel
def left_at(w: Columns, p: int, d: float) -> float:
    """Return what is left of the peak at d pitches by the law of a patch that is no cone."""
    x = d * (PROFILE - 1) / PROFILE_SPAN
    k = int(x)
    if k >= PROFILE - 1:
        return 0.0
    return float(w.profile[p, k] + (x - k) * (w.profile[p, k + 1] - w.profile[p, k]))
