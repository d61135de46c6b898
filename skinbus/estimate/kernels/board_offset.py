"""What the readings of a board have in common below the threshold: a nuisance of the board, no contact.

::

    offset ~ N(0, C)        C = (a quarter of the threshold)^2
    mean of the readings | offset ~ N(offset, sigma^2 / n)

Zeros of a board move together, with its temperature and supply, faster than a baseline follows. On a board
with touched tactels, yet no certain press, the posterior mean of the offset is subtracted, by the readings
within three sigma of their median, and tactels that only the offset has touched are free. A press is certain
where a touched tactel is still touched less the median, with tactels above noise that together are a contact,
or where the pressure is more than any offset explains. On such a board and those side by side with it the
median is not that of an offset alone: there the offset is an unknown of the search, ``offset_variance``.

Failure modes: what presses all of a board alike by less than the threshold is an offset; an offset stays
under a press and beside it.
"""

from __future__ import annotations

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
"""Share of the threshold from which on a held tactel is pressed: a baseline releases it at 0.84 or less.
So much must also be left at level ``kmeans``."""
LEAST: Final = 4
"""Tactels of which a median is taken: fewer may all be pressed."""


@inner_kernel
def subtract_offsets(lay: Layout, w: Work, faint: bool) -> None:
    """Subtract the offsets of boards from ``p``; free the tactels that only those touch.

    A board that nothing touches counts, too, beside one that something does: a contact there reads both.
    """
    touched, pressed = w.touched, w.pressed
    any_touched = False
    for patch in range(len(touched)):
        pressed[patch] = touched[patch] and _is_pressed(lay, w, patch)
        w.offset_variance[patch, 0] = w.offset_variance[patch, 1] = 0.0
        any_touched |= touched[patch]
    if not any_touched:
        return
    for patch in range(len(touched)):
        near, beside = touched[patch], pressed[patch]
        for e in range(lay.near_start[patch], lay.near_start[patch + 1]):
            near |= touched[lay.near_to[e]]
            beside |= pressed[lay.near_to[e]]
        if beside and _quartile(lay, w, patch) <= MOST * USUAL * lay.threshold[lay.patch_start[patch]]:
            w.offset_variance[patch, 1] = (USUAL * lay.threshold[lay.patch_start[patch]]) ** 2
        elif near:
            w.order[patch] = 1  # ``touched`` of neighbours is still needed
        if beside or not near:
            w.order[patch] = 0
    for patch in range(len(touched)):
        if w.order[patch] == 1:
            _subtract(lay, w, patch, faint)


@inner_kernel
def _subtract(lay: Layout, w: Work, patch: int, faint: bool) -> None:
    """Subtract the offset (Pa) of a board and free the tactels that only it touches."""
    p, active, held = w.p, w.active, w.held
    offset, variance = _offset_of(lay, w, patch)
    w.offset_variance[patch, 0] = w.offset_variance[patch, 1] = variance
    found = False
    for i in range(lay.patch_start[patch], lay.patch_start[patch + 1]):
        if w.state[i] == NO_VALUE:
            continue
        p[i] -= offset
        if p[i] < lay.threshold[i] and offset > 0.0:
            held[i] = False
            least = FAINT * lay.sigma[i] if faint else RELEASE * lay.threshold[i]
            active[i] = active[i] and p[i] >= least
        active[i] = active[i] and p[i] > 0.0
        found |= active[i]
    w.touched[patch] = found


@inner_kernel
def _offset_of(lay: Layout, w: Work, patch: int) -> tuple[float, float]:
    """Return mean (Pa) and variance of the offset of a board that nothing presses for certain."""
    i0 = lay.patch_start[patch]
    n = _sort(w, i0, lay.patch_start[patch + 1])
    median, total, counted = _median(w, n), 0.0, 0
    for t in range(n):
        if abs(w.sorted[t] - median) <= FAINT * lay.sigma[i0]:
            total += w.sorted[t]
            counted += 1
    prior, noise = (USUAL * float(lay.threshold[i0])) ** 2, float(lay.sigma[i0]) ** 2
    if not counted * prior > 0.0:
        return 0.0, 0.0
    return total * prior / (counted * prior + noise), prior * noise / (counted * prior + noise)


@inner_kernel
def _is_pressed(lay: Layout, w: Work, patch: int) -> bool:
    """Return whether a board is pressed for certain, or has too few tactels to decide that."""
    i0, i1 = lay.patch_start[patch], lay.patch_start[patch + 1]
    for i in range(i0, i1):
        if w.state[i] != NO_VALUE and w.p[i] >= CLEAR * lay.threshold[i]:
            return True
    n = _sort(w, i0, i1)
    median = _median(w, n)
    if n < LEAST or abs(median) > MOST * USUAL * lay.threshold[i0]:
        return True
    evidence, is_touched = 0.0, False
    for i in range(i0, i1):
        if w.state[i] == NO_VALUE:
            continue
        p = w.p[i]
        above = p - median
        if above >= FAINT * lay.sigma[i]:
            evidence += (above / lay.sigma[i]) ** 2
        if w.held[i] and above >= RELEASE * lay.threshold[i]:
            return True
        is_touched |= above >= lay.threshold[i]
    return is_touched and evidence >= EVIDENCE


@inner_kernel
def _quartile(lay: Layout, w: Work, patch: int) -> float:
    """Return the pressure (Pa) that a quarter of a board's tactels read at most; 0 of none."""
    n = _sort(w, lay.patch_start[patch], lay.patch_start[patch + 1])
    return float(w.sorted[n // 4]) if n > 0 else 0.0


@inner_kernel
def _sort(w: Work, i0: int, i1: int) -> int:
    """Write the pressures of tactels from i0 to i1 to ``sorted`` in rising order; return how many."""
    ordered, n = w.sorted, 0
    for i in range(i0, i1):
        if w.state[i] == NO_VALUE:
            continue
        value, k = w.p[i], n
        while k > 0 and ordered[k - 1] > value:
            ordered[k] = ordered[k - 1]
            k -= 1
        ordered[k] = value
        n += 1
    return n


@inner_kernel
def _median(w: Work, n: int) -> float:
    """Return the median of the n pressures sorted last, Pa; 0 of none."""
    return 0.5 * (w.sorted[(n - 1) // 2] + w.sorted[n // 2]) if n > 0 else 0.0
