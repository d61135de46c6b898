"""The offset of a board: what all its readings have in common, a nuisance and no contact.

The zeros of a board move together, with its temperature and supply, faster than a baseline follows.

* A touched board is *pressed* for certain where one of these holds: a tactel exceeds the median by the
  threshold, and all that exceed it together are a contact (``EVIDENCE``); a held tactel still exceeds it; the
  median is larger than any offset.
* A touched board that is not pressed, and has no pressed board beside it: the median is subtracted. Tactels
  that only the offset made touched are free.
* Any other board: a press may have raised the median, or nothing was read to take one. Nothing is subtracted;
  the search may fit the offset, with the prior ``offset_variance``, unless the median is larger than any
  offset.

Failure modes: a press on all of a board alike, below the threshold, is taken for an offset; kmeans keeps the
offset of a pressed board and of those beside it.
"""

from __future__ import annotations

from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.workspace import NO_VALUE, Work
from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.jit import inner_kernel

OFFSET_SD = 0.25
"""Standard deviation of an offset, in thresholds: 250 Pa on the usual board. A board whose zeros move further
has a higher threshold."""
FURTHEST = 3.0
"""Largest offset, in its standard deviations: a median beyond is of a press."""
PRESSES = 3.0
"""Standard deviations above the median from which on a reading counts as pressed."""
RELEASE = 0.8
"""Share of the threshold that must be left of a touch; a baseline releases held tactels at 0.84 or less."""
LEAST_TACTELS = 4
"""Least tactels for a median: fewer may all be pressed."""


@inner_kernel
def subtract_offsets(lay: Layout, w: Work) -> None:
    """Subtract the offsets of boards from ``p``; free the tactels that only offsets have touched."""
    p, active, start = w.p, w.active, lay.patch_start
    for patch in range(len(w.touched)):
        w.offset[patch], w.pressed[patch] = find_offset(lay, w, patch) if w.touched[patch] else (0.0, False)
    for patch in range(len(w.touched)):
        free = w.touched[patch] and not w.pressed[patch]
        for e in range(lay.edge_start[start[patch]], lay.edge_start[start[patch + 1]] if free else 0):
            free &= not w.pressed[lay.patch[lay.edge_to[e]]]
        usual = OFFSET_SD * lay.threshold[start[patch]]
        w.offset_variance[patch] = 0.0 if free or abs(w.offset[patch]) > FURTHEST * usual else usual * usual
        for i in range(start[patch], start[patch + 1] if free else 0):
            if w.state[i] != NO_VALUE:
                p[i] -= w.offset[patch]
                w.held[i] &= p[i] >= lay.threshold[i]
                active[i] &= p[i] >= RELEASE * lay.threshold[i]


@inner_kernel
def find_offset(lay: Layout, w: Work, patch: int) -> tuple[float, bool]:
    """Return the median of a board (Pa), and whether it is pressed or has too few tactels to decide that."""
    i0, i1, n, ordered = lay.patch_start[patch], lay.patch_start[patch + 1], 0, w.sorted
    for i in range(i0, i1):
        if w.state[i] == NO_VALUE:
            continue
        k = n
        while k > 0 and ordered[k - 1] > w.p[i]:
            ordered[k] = ordered[k - 1]
            k -= 1
        ordered[k] = w.p[i]
        n += 1
    if n < LEAST_TACTELS:
        return 0.0, True
    median, evidence, stands_out = 0.5 * (ordered[(n - 1) // 2] + ordered[n // 2]), 0.0, False
    is_pressed = abs(median) > FURTHEST * OFFSET_SD * lay.threshold[i0]
    for i in range(i0, i1):
        above = w.p[i] - median
        if w.state[i] != NO_VALUE and above >= PRESSES * lay.sigma[i]:
            evidence += (above / lay.sigma[i]) ** 2
            stands_out |= above >= lay.threshold[i]
            is_pressed |= w.held[i] and above >= RELEASE * lay.threshold[i]
    return median, is_pressed or (stands_out and evidence >= EVIDENCE)
