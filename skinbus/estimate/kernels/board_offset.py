"""What the readings of a board have in common below the threshold: a nuisance of the board, no contact.

::

    offset ~ N(0, C)        C = (a quarter of the threshold)^2
    median of the readings | offset ~ N(offset, pi/2 sigma^2 / n)

Zeros of a board move together, with its temperature and supply, faster than a baseline follows. On a board
that feels something, yet no press for sure, the posterior mean of the offset is subtracted, and the tactels
that only it has touched are free. A press for sure is a touched tactel that is still touched less the median,
with tactels above noise that together are a contact; or more than any offset explains. Such a board keeps its
readings: there the median is not that of an offset alone.

Failure modes: what presses all of a board alike by less than the threshold is an offset; an offset stays
under a press.
"""

from __future__ import annotations

import math
from typing import Final

from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.workspace import NO_VALUE, Work
from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.jit import inner_kernel

USUAL: Final = 0.25
"""Standard deviation of a step of a board's zeros, in thresholds: 250 Pa on the usual board; one whose zeros
move further has a higher threshold."""
MOST: Final = 3.0
"""Standard deviations of the prior; a median beyond is that of a press."""
FAINT: Final = 3.0
"""Standard deviations of a reading: where contacts are fitted, several tactels that feel little make one."""
CLEAR: Final = 2.0
"""Thresholds that no offset explains: four standard deviations of it, and five of a reading's noise."""
RELEASE: Final = 0.8
"""Share of the threshold from which on a held tactel is pressed: a baseline releases it at 0.84 or less."""
LEAST: Final = 4
"""Tactels of which a median is taken: fewer may all be pressed."""


@inner_kernel
def subtract_offset(lay: Layout, w: Work, patch: int) -> bool:
    """Subtract the offset of a board from its pressures in ``p`` and free the tactels that only it touches.

    Returns whether any is still active.
    """
    i0, i1 = lay.patch_start[patch], lay.patch_start[patch + 1]
    p, active, held = w.p, w.active, w.held
    median, n = _median(w, i0, i1)
    prior = (USUAL * lay.threshold[i0]) ** 2
    if n < LEAST or median * median > MOST * MOST * prior or _is_pressed(lay, w, i0, i1, median):
        return True
    sigma = lay.sigma[i0]
    offset = median * prior / (prior + 0.5 * math.pi * sigma * sigma / n)
    found = False
    for i in range(i0, i1):
        if w.state[i] == NO_VALUE:
            continue
        p[i] -= offset
        if p[i] < lay.threshold[i]:
            held[i] = False
            active[i] = active[i] and p[i] >= FAINT * lay.sigma[i]
        found |= active[i]
    return found


@inner_kernel
def _is_pressed(lay: Layout, w: Work, i0: int, i1: int, median: float) -> bool:
    """Return whether a board of this median (Pa) is pressed for sure."""
    evidence, is_touched = 0.0, False
    for i in range(i0, i1):
        if w.state[i] == NO_VALUE:
            continue
        p = w.p[i]
        above = p - median
        if above >= FAINT * lay.sigma[i]:
            evidence += (above / lay.sigma[i]) ** 2
        if p >= CLEAR * lay.threshold[i] or (w.held[i] and above >= RELEASE * lay.threshold[i]):
            return True
        is_touched |= above >= lay.threshold[i]
    return is_touched and evidence >= EVIDENCE


@inner_kernel
def _median(w: Work, i0: int, i1: int) -> tuple[float, int]:
    """Return the median of the pressures of tactels from i0 to i1, by insertion, and how many there are."""
    ordered, n = w.pull, 0
    for i in range(i0, i1):
        if w.state[i] == NO_VALUE:
            continue
        value, k = w.p[i], n
        while k > 0 and ordered[k - 1] > value:
            ordered[k] = ordered[k - 1]
            k -= 1
        ordered[k] = value
        n += 1
    if n == 0:
        return 0.0, 0
    return 0.5 * (ordered[(n - 1) // 2] + ordered[n // 2]), n
