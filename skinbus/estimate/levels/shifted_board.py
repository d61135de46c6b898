"""Contacts beside a board whose zeros have moved together: what all of it reads looks like their skirt.

The skirt of a strong contact in a gap between boards and an offset of a board beside a weak one read nearly
alike, and a press that is certain keeps offsets from being subtracted (``board_offset``). Tactels that are
too far from a contact to determine it show the difference: where two thirds of those of a board read more
than noise, more than a part of what the contact reads, and more than contacts explain, it is flagged.

Failure mode: an offset below a standard deviation of the noise, or of a twentieth of what a contact reads.
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.constants import BAD_FIT
from skinbus.estimate.kernels.geometry import separation, surface_of
from skinbus.estimate.kernels.law import amplitude, peak_pressure, profile
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.workspace import NO_VALUE, Work
from skinbus.jit import inner_kernel

FAR = 0.022
"""m, two pitches: there a law has half a per cent of its peak."""
BESIDE, FAINT = 0.012, 0.25
"""m, and standard deviations of a reading: what a contact adds less to, a pitch away, is also far from it."""
LEAST = 8
"""Tactels of a board: chance takes two thirds of so many above their noise once in 3000."""
MOST_OF = 2.0 / 3.0
NOISE = 1.0
"""Standard deviations of a reading."""
PART = 0.05
"""Of the strongest reading of a contact: discs of 25 mm leave 2 % where a fingertip leaves nothing."""


@inner_kernel
def is_beside_shifted(lay: Layout, w: Work, c: int) -> bool:
    """Return whether all of the board of contact c, or of one beside it, reads what no contact explains."""
    strongest, patch = 0.0, w.patch[c]
    surface = surface_of(lay.link, w.link[c])
    first, last = lay.near_start[patch], lay.near_start[patch + 1]
    for e in range(first - 1, last):
        board = patch if e < first else lay.near_to[e]
        for i in range(lay.patch_start[board], lay.patch_start[board + 1]):
            d2, _, _ = separation(surface, w.s[c], w.a[c], lay.s[i], lay.a[i])
            if d2 <= FAR * FAR and w.state[i] != NO_VALUE:
                strongest = max(strongest, w.p[i])
    peak = peak_pressure(lay.law_par, lay.law_table, lay.law[lay.patch_start[patch]], w.log_force[c])
    least = PART * min(strongest, peak / (w.width[c] * w.width[c]))
    for e in range(first - 1, last):
        if is_shifted(lay, w, c, patch if e < first else lay.near_to[e], least):
            return True
    return False


@inner_kernel
def is_shifted(lay: Layout, w: Work, c: int, board: int, least: float) -> bool:
    """Return whether most tactels of a board that are far from contact c read more than contacts explain.

    ``least`` (Pa) is what counts as more.
    """
    far, above = 0, 0
    for i in range(lay.patch_start[board], lay.patch_start[board + 1]):
        if is_far(lay, w, c, i):
            far += 1
            above += w.p[i] > max(NOISE * lay.sigma[i], least)
    if far < LEAST or above < MOST_OF * far:
        return False
    above = 0
    for i in range(lay.patch_start[board], lay.patch_start[board + 1]):
        if is_far(lay, w, c, i):
            above += w.p[i] - explained(lay, w, i) > max(NOISE * lay.sigma[i], least)
    return above >= MOST_OF * far


@inner_kernel
def is_far(lay: Layout, w: Work, c: int, i: int) -> bool:
    """Return whether tactel i has a reading and says next to nothing of contact c."""
    d2, _, _ = separation(surface_of(lay.link, w.link[c]), w.s[c], w.a[c], lay.s[i], lay.a[i])
    if w.state[i] == NO_VALUE or d2 <= BESIDE * BESIDE:
        return False
    return d2 > FAR * FAR or pressure_of(lay, w, c, i) < FAINT * lay.sigma[i]


@inner_kernel
def pressure_of(lay: Layout, w: Work, c: int, i: int) -> float:
    """Return what tactel i reads of contact c, Pa."""
    law = lay.law[i]
    d2, _, _ = separation(surface_of(lay.link, w.link[c]), w.s[c], w.a[c], lay.s[i], lay.a[i])
    amp, _ = amplitude(lay.law_par, law, w.log_force[c])
    own = lay.narrow[i] / w.width[c]
    k, _ = profile(lay.law_par, lay.law_table, law, math.sqrt(d2) * own)
    return float(amp * own * own * k)


@inner_kernel
def explained(lay: Layout, w: Work, i: int) -> float:
    """Return what tactel i reads (Pa) of all contacts whose law is true of them."""
    link, total = lay.patch_link[lay.patch[i]], 0.0
    for c in range(w.n_contacts[0]):
        if w.link[c] == link and not w.quality[c] & BAD_FIT:
            total += pressure_of(lay, w, c, i)
    return total
