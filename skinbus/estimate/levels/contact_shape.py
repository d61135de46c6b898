"""Contacts whose law is not quite that of what presses: another cover, or an indenter that is not round.

A law is that of one cover and of round indenters. Inside a board the tactels around a contact show most of
what differs; beyond the outermost of them a force is read off the slope of the law, and what differs there
is taken for place and force. Its effect is that of parameters which are not estimated (Schmidt)::

    d theta = -C J'W m e,    m the change of the readings by one unit of the parameter e

The first is the width of the law, 1 + e times its own. The other two, under a law that was not measured with
what presses, are the second moments of a long indenter beyond those of a round one; the readings decide
between round and long as they do between sizes, and the covariance is that of both.

Assumption: small changes, so that their effects add. Failure: bars much longer than the law is wide, which
are flagged MISFIT or found to be several contacts.
Source: S. Schmidt, Application of state-space methods to navigation problems (1966), consider parameters;
D. Titterington, A. Smith, U. Makov, Statistical Analysis of Finite Mixture Distributions (1985), 2.
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.board_places import in_board
from skinbus.estimate.kernels.constants import BAD_FIT, FEW_TACTELS
from skinbus.estimate.kernels.covariance import add_prior, invert
from skinbus.estimate.kernels.disc_shapes import ANY_SIZE, COVERS
from skinbus.estimate.kernels.geometry import distance, separation, surface_of
from skinbus.estimate.kernels.law import KIND, PROFILED, UNSIZED, amplitude, curved_profile
from skinbus.estimate.kernels.layout import CONE, Floats, Layout
from skinbus.estimate.kernels.workspace import NO_VALUE, Work
from skinbus.estimate.levels.shifted_board import is_beside_shifted
from skinbus.jit import inner_kernel, runtime_int

LONG = 8e-6
"""m^2, standard deviation of either second moment: a bar of 15 x 8 mm has 7e-6, one of 25 x 10 mm 22e-6."""
LONG_SHARE = 0.2
"""Prior share of what is long, as of tips and of thumbs."""
DIRECTIONS = tuple((math.cos(math.pi * i / 8), math.sin(math.pi * i / 8)) for i in range(16))
BEYOND = 0.024
"""m: tactels further away than two pitches do not surround a contact."""
AT_RIM, OUTSIDE = 0.5, 0.2
"""Cosines: a tactel within 60 degrees of a direction closes it, so that the outermost row is at the rim;
within 78 degrees, so that only what is beyond is outside."""
RIM_PLACE, RIM_FORCE = 1.6e-3, 0.25
"""m along each axis, and part of the force, standard deviations outside the outermost tactels: there a bar of
25 x 10 mm reads like a finger 4 to 5 mm away of six tenths of the force, and one press in five is long."""
PAIR_APART = 0.025
"""m between contacts that share tactels: of two at a rim the slope of one and the place of the other read
alike, so that one in ten is 6 mm and a factor 2 off."""
AROUND = 0.016
"""m: the same as ``BEYOND`` for such ones at level ``fit``, which does not look for them on the other side of
a gap between boards."""
LEARNED = 0.125
"""Part of these under a law that was learned from presses, whose misfit has most of it."""
UNKNOWN_FORCE = 1.0 / 3.0
"""Relative standard deviation of a force from which on the tactels do not determine it beside the place: none
is within three of them."""


@inner_kernel
def open_side(
    lay: Layout, w: Work, link: int, s: float, a: float, n: int, ahead: float
) -> tuple[float, float]:
    """Return the unit vector (s, a) to where no listed tactel is near a place; zeros if there is none.

    ``ahead`` is the cosine to a direction from which on a tactel is in it. Where several directions are open,
    at a rim or beyond, it is their middle.
    """
    surface = surface_of(lay.link, link)
    left = runtime_int(2 ** len(DIRECTIONS) - 1)  # a bit for each that no tactel has closed
    for t in range(n):
        i = w.list[t]
        d2, x, y = separation(surface, s, a, lay.s[i], lay.a[i])
        if d2 < BEYOND * BEYOND:
            least = ahead * math.sqrt(d2)
            for turn in range(len(DIRECTIONS)):
                cos, sin = DIRECTIONS[turn]
                left &= ~((-cos * x - sin * y > least) << turn)
            if left == 0:
                return 0.0, 0.0
    out_s, out_a = 0.0, 0.0
    for turn in range(len(DIRECTIONS)):
        if left & (1 << turn):
            out_s, out_a = out_s + DIRECTIONS[turn][0], out_a + DIRECTIONS[turn][1]
    size = math.sqrt(out_s * out_s + out_a * out_a)
    if size < 1e-6:
        return 0.0, 0.0
    return out_s / size, out_a / size


@inner_kernel
def changes_of(
    lay: Layout, link: int, i: int, at: Floats, amp: float, wide: float
) -> tuple[float, float, float]:
    """Return what tactel i reads more (Pa) by a unit of each parameter, under a contact of this amplitude.

    They are the relative width of the law, and the two second moments (m^2).
    """
    law, laws = lay.law[i], lay.law_par
    if laws[law, KIND] == CONE:
        return 0.0, 0.0, 0.0
    d2, x, y = separation(surface_of(lay.link, link), at[0], at[1], lay.s[i], lay.a[i])
    own = lay.narrow[i] / wide
    d = math.sqrt(d2) * own
    k, k_d, k_dd = curved_profile(laws, lay.law_table, law, d)
    amp /= wide * wide
    width = -amp * (2.0 * k + d * k_d)
    if laws[law, UNSIZED] == 0.0 or not d > 0.0:
        return width, 0.0, 0.0
    bend = 0.5 * amp * own * own * (k_dd - k_d / d) / d2
    return width, bend * (x * x - y * y), bend * 2.0 * x * y


@inner_kernel
def allow_for_shape(lay: Layout, w: Work, link: int, c: int, n: int, at: Floats, wide: float) -> float:
    """Add to ``normal_trial``, the covariance of contact c (s, a, force, size), what its law may be wrong by.

    ``at`` is its place, log force and size as evaluated last; the others of its group are held. Returns the
    posterior share of what is long; ``step`` has the change of s, a, force, size that goes with it.
    """
    moment, own, inverse, off, first = w.normal_trial, w.normal, w.inverse, w.step, 4
    force = math.exp(at[2])
    for x in range(4):
        off[x] = own[x, x] = 0.0
        for y in range(x):
            own[x, y] = 0.0
        for e in range(7):
            own[first + x, e] = 0.0
    w11 = w22 = 1.0 / (LONG * LONG)
    w12 = b1 = b2 = amp = 0.0
    last = -1
    for m in range(w.n_felt[c]):
        t = w.felt_at[c, m]
        i, counts = w.list[t], w.counts[t]
        if counts == 0.0:
            continue
        if lay.law[i] != last:
            last = lay.law[i]
            amp, _ = amplitude(lay.law_par, last, at[2])
        z0, z1, z2 = changes_of(lay, link, i, at, amp, wide)
        for x in range(4):
            slope = w.felt[c, m, x]
            own[first + x, 6] += slope * w.pull[t]
            slope *= counts
            for y in range(x + 1):
                own[x, y] += slope * w.felt[c, m, y]
            own[first + x, 0] += slope * z0
            own[first + x, 1] += slope * z1
            own[first + x, 2] += slope * z2
        w11 += counts * z1 * z1
        w12 += counts * z1 * z2
        w22 += counts * z2 * z2
        b1 += z1 * w.pull[t]
        b2 += z2 * w.pull[t]
    add_prior(w, 1)
    own[3, 3] += 1.0 / (ANY_SIZE * ANY_SIZE)
    invert(w, 4)
    # what the others of its unknowns take over of each parameter; with them none is known better than before
    for x in range(4):
        for e in range(3):
            for y in range(4):
                own[first + x, 3 + e] -= inverse[x, y] * own[first + y, e]
    for x in range(4):
        w11 += own[first + x, 1] * own[first + x, 4]
        w12 += own[first + x, 1] * own[first + x, 5]
        w22 += own[first + x, 2] * own[first + x, 5]
        b1 += own[first + x, 6] * own[first + x, 4]
        b2 += own[first + x, 6] * own[first + x, 5]
    det = w11 * w22 - w12 * w12
    if not det > 0.0:
        return 0.0
    e1, e2 = (w22 * b1 - w12 * b2) / det, (w11 * b2 - w12 * b1) / det
    log_odds = 0.5 * (e1 * b1 + e2 * b2) - 0.5 * math.log(det * LONG**4)
    odds = LONG_SHARE / (1.0 - LONG_SHARE) * math.exp(min(log_odds, 50.0))
    share = odds / (1.0 + odds)
    for x in range(4):
        scale = force if x == 2 else 1.0
        for e in range(3, 6):
            own[first + x, e] *= scale
        off[x] = own[first + x, 4] * e1 + own[first + x, 5] * e2
    for x in range(4):
        p0, p1, p2 = own[first + x, 3], own[first + x, 4], own[first + x, 5]
        for y in range(x + 1):
            q0, q1, q2 = own[first + y, 3], own[first + y, 4], own[first + y, 5]
            long = (p1 * (w22 * q1 - w12 * q2) + p2 * (w11 * q2 - w12 * q1)) / det
            moment[x, y] += COVERS * COVERS * p0 * q0 + share * long
            moment[y, x] = moment[x, y]
    return share


@inner_kernel
def doubt_rims(lay: Layout, w: Work) -> None:
    """Flag contacts whose force the tactels do not determine; doubt those outside the outermost tactels.

    Flagged is also one at a rim beside another, and one beside a board whose zeros have moved. The covariance
    outside has what long indenters do there, under the law of a real skin, unless they were weighed one by
    one (``long_contact``), as the force was before that: a cone is what it says.
    """
    for c in range(w.n_contacts[0]):
        patch, link = w.patch[c], w.link[c]
        law = lay.law[lay.patch_start[patch]]
        if w.level[c] == 0 or lay.law_par[law, PROFILED] + lay.law_par[law, UNSIZED] == 0.0:
            continue
        is_learned = lay.law_par[law, PROFILED] != 0.0
        is_weighed = w.width_sd[c] > 0.0 and not is_learned and not has_neighbour(lay, w, c)
        if not is_weighed and is_outside(lay, w, link, patch, w.s[c], w.a[c], OUTSIDE, BEYOND):
            part = LEARNED if is_learned else 1.0
            w.covariance[c, 0, 0] += (part * RIM_PLACE) ** 2
            w.covariance[c, 1, 1] += (part * RIM_PLACE) ** 2
            w.covariance[c, 2, 2] += (part * RIM_FORCE * math.exp(w.log_force[c])) ** 2
        around = BEYOND if w.level[c] > 1 else AROUND
        if (not is_weighed and w.covariance[c, 2, 2] > (UNKNOWN_FORCE * math.exp(w.log_force[c])) ** 2) or (
            has_neighbour(lay, w, c) and is_outside(lay, w, link, patch, w.s[c], w.a[c], AT_RIM, around)
        ):
            w.quality[c] |= FEW_TACTELS
        if is_beside_shifted(lay, w, c):
            w.quality[c] |= BAD_FIT


@inner_kernel
def has_neighbour(lay: Layout, w: Work, c: int) -> bool:
    """Return whether there is another contact within ``PAIR_APART`` of contact c."""
    surface, found = surface_of(lay.link, w.link[c]), False
    for e in range(w.n_contacts[0]):
        if e != c and w.link[e] == w.link[c] and abs(w.s[e] - w.s[c]) < PAIR_APART:
            found |= distance(surface, w.s[c], w.a[c], w.s[e], w.a[e]) < PAIR_APART
    return found


@inner_kernel
def is_outside(
    lay: Layout, w: Work, link: int, patch: int, s: float, a: float, ahead: float, around: float
) -> bool:
    """Return whether a place is outside the outermost tactels that have readings, those of a patch first.

    ``ahead`` is the cosine of :func:`open_side`.
    """
    u, v = in_board(lay, link, patch, s, a)
    if ahead <= OUTSIDE and abs(u) <= lay.extent[patch, 0] and abs(v) <= lay.extent[patch, 1]:
        return False
    n = list_board(lay, w, patch, 0, s, a, around)
    for e in range(lay.near_start[patch], lay.near_start[patch + 1]):
        n = list_board(lay, w, lay.near_to[e], n, s, a, around)
    out_s, out_a = open_side(lay, w, link, s, a, n, ahead)
    return out_s != 0.0 or out_a != 0.0


@inner_kernel
def list_board(lay: Layout, w: Work, patch: int, n: int, s: float, a: float, around: float) -> int:
    """List the tactels of a patch that have a reading after the first n; return how many there are then.

    Only those within ``around`` (m) of a place.
    """
    surface = surface_of(lay.link, lay.patch_link[patch])
    for i in range(lay.patch_start[patch], lay.patch_start[patch + 1]):
        if w.state[i] != NO_VALUE and separation(surface, s, a, lay.s[i], lay.a[i])[0] < around * around:
            w.list[n] = i
            n += 1
    return n
