"""What the readings of a board have in common below the threshold: a nuisance of the board, no contact.

Zeros of a board move together, with its temperature and supply, faster than a baseline follows. From a board
with touched tactels, yet no certain press, the median is subtracted, and tactels that it alone has touched
are free. A press is certain where a tactel stands out of the median by the threshold and what stands out is
together a contact, where a held tactel stands out, or where the median is more than any offset explains. On
such a board and those side by side with it the median is not that of an offset alone: there, and where
nothing is touched, the offset is an unknown of the search, ``offset_variance``, unless the median is beyond
any.

Failure modes: what presses all of a board alike by less than the threshold is an offset; an offset stays
under a press and beside it.
"""

from __future__ import annotations

from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.workspace import NO_VALUE, Work
from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.jit import inner_kernel

USUAL = 0.25
"""Standard deviation of a step of a board's zeros, in thresholds: 250 Pa on the usual board; one whose zeros
move further has a higher threshold."""
MOST = 3.0
"""Standard deviations of the offset: a median beyond is that of a press."""
ABOVE = 3.0
"""Standard deviations of a reading from which on it says that something presses."""
RELEASE = 0.8
"""Share of the threshold that must be left of a touch: a baseline releases a held tactel at 0.84 or less."""
LEAST = 4
"""Tactels of which a median is taken: fewer may all be pressed."""


@inner_kernel
def subtract_offsets(lay: Layout, w: Work) -> None:
    """Subtract the offsets of boards from ``p``; free the tactels that only those touch."""
    p, active, start = w.p, w.active, lay.patch_start
    for patch in range(len(w.touched)):
        w.offset[patch], w.pressed[patch] = find_offset(lay, w, patch) if w.touched[patch] else (0.0, False)
    for patch in range(len(w.touched)):
        free = w.touched[patch] and not w.pressed[patch]
        for e in range(lay.edge_start[start[patch]], lay.edge_start[start[patch + 1]] if free else 0):
            free &= not w.pressed[lay.patch[lay.edge_to[e]]]
        usual = USUAL * lay.threshold[start[patch]]
        w.offset_variance[patch] = 0.0 if free or abs(w.offset[patch]) > MOST * usual else usual * usual
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
    if n < LEAST:
        return 0.0, True
    median, evidence, stands_out = 0.5 * (ordered[(n - 1) // 2] + ordered[n // 2]), 0.0, False
    is_pressed = abs(median) > MOST * USUAL * lay.threshold[i0]
    for i in range(i0, i1):
        above = w.p[i] - median
        if w.state[i] != NO_VALUE and above >= ABOVE * lay.sigma[i]:
            evidence += (above / lay.sigma[i]) ** 2
            stands_out |= above >= lay.threshold[i]
            is_pressed |= w.held[i] and above >= RELEASE * lay.threshold[i]
    return median, is_pressed or (stands_out and evidence >= EVIDENCE)
