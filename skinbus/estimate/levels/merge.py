"""One contact across seams: clusters are merged when one contact explains them as well as two.

Two clusters that border on each other across a seam are one contact, if

* there is no valley between them: pressure does not fall, on the way from the lower maximum to the
  higher one, by more than noise and spread of gains make it (the rule of ``cluster``), and
* the contact law with one contact fits the tactels of both, and the silent ones of their patches, as
  well as with two, up to ``WORTH``. The law is only nearly true, so a reading counts with the standard
  deviation sqrt(sigma^2 + (MISFIT p)^2 + (SPILL p_0)^2) here, p_0 the pressure right under the one contact.

Borders are tried from the highest saddle down, so that four patches at a corner, or a contact as wide
as a ring of patches, come together one by one. Distances wrap with the surface.

The force of a contact inverts the law (paper, eq. 10, 5, 6) in the sum over its tactels: the amplitude A with
which sum (A g_j + h_j) is the pressure that they read. For the cone it is the mean of H_j = p_j + S d_j.
Errors of the centroid raise some terms and lower those opposite, and the sum of a law over a grid hardly
depends on where in the grid it stands. On the corner of four boards, where all feel less than ``SPILL``
of the peak, its force is not determined: there the law counts as that much.

Failure: two contacts either side of a seam, nearer to each other than to any tactel between them.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.board_places import off_board, onto_board
from skinbus.estimate.kernels.constants import MAX_MOVE, OVER_BUDGET
from skinbus.estimate.kernels.geometry import develop, distance, surface_of, undevelop
from skinbus.estimate.kernels.law import affine, log_force_of, peak_pressure
from skinbus.estimate.kernels.layout import Floats, Ints, Layout
from skinbus.estimate.kernels.least_squares import (
    LOG_FORCE_MAX,
    LOG_FORCE_MIN,
    ROUGH,
    fit,
)
from skinbus.estimate.kernels.listed import list_place
from skinbus.estimate.kernels.workspace import CLEAR, NO_VALUE, OWNED, Work
from skinbus.estimate.levels.kmeans import DIP, STANDS_OUT, find_root
from skinbus.jit import inner_kernel, runtime_int

MISFIT = 0.1
"""Part of a reading by which a law is wrong there: a cone for an elastic layer, and the spread of gains."""
SPILL = 0.05
"""Part of the pressure under a contact by which a law is wrong elsewhere: the foot of a real field."""
SPILL_MOST = 3.5
"""Times the largest reading, the most that pressure is: midway between two touches the law's force, and with
it this pressure, is out of all proportion."""
WORTH = 16.0
"""chi^2 that a second contact must save to be kept: three parameters, and four times noise."""
MERGE_ITERATIONS = 20
EVIDENCE = 42.0
"""Sum of (p/sigma)^2 below which a contact is taken for noise: 6.5 sigma on one tactel, which 384 tactels
show by chance once in 5e7 cycles."""


@inner_kernel
def list_borders(lay: Layout, w: Work, n_clusters: int) -> int:
    """Write the pairs of bordering clusters of different patches, highest saddle first; return how many.

    At a corner one tactel is the saddle to two patches: then what is on its other side decides, not which
    patch has the lower number.
    """
    edge_start, edge_to, label, state = lay.edge_start, lay.edge_to, w.label, w.state
    if w.n_gaps[0] == 0:  # there is nothing to step over: those on the other side of a seam are enough
        edge_start, edge_to = lay.seam_start, lay.seam_to
    pair_a, pair_b, pair_saddle, pair_slope = w.pair_a, w.pair_b, w.pair_saddle, w.pair_slope
    n_pairs = runtime_int(0)
    for patch in range(len(lay.patch_link)):
        if not w.touched[patch]:
            continue
        known = runtime_int(n_pairs)  # pairs of earlier patches: none of them is met again
        for i in range(lay.patch_start[patch], lay.patch_start[patch + 1]):
            if label[i] < 0:
                continue
            for e in range(edge_start[i], edge_start[i + 1]):
                j = edge_to[e]
                if state[j] != NO_VALUE and label[j] < 0:
                    continue
                if state[j] != NO_VALUE:
                    n_pairs = _note_border(
                        lay.patch, w.p, label, pair_a, pair_b, pair_saddle, pair_slope, i, j, known, n_pairs
                    )
                    continue
                for f in range(edge_start[j], edge_start[j + 1]):
                    j2 = edge_to[f]
                    n_pairs = _note_border(
                        lay.patch, w.p, label, pair_a, pair_b, pair_saddle, pair_slope, i, j2, known, n_pairs
                    )
    for root in range(n_pairs // 2 - 1, -1, -1):
        _sink(w, root, n_pairs)
    for end in range(n_pairs - 1, 0, -1):
        _swap(w, 0, end)
        _sink(w, runtime_int(0), end)
    return n_pairs


@inner_kernel
def _sink(w: Work, i: int, n: int) -> None:
    """Restore the heap of n pairs, the one to be tried last on top, below row i (heapsort)."""
    while True:
        child = 2 * i + 1
        if child >= n:
            return
        if child + 1 < n and _is_before(w, child, child + 1):
            child += 1
        if not _is_before(w, i, child):
            return
        _swap(w, i, child)
        i = child


@inner_kernel
def _is_before(w: Work, i: int, j: int) -> bool:
    """Return whether the border in row i is to be tried before that in row j."""
    if w.pair_saddle[i] != w.pair_saddle[j]:
        return bool(w.pair_saddle[i] > w.pair_saddle[j])
    if w.pair_slope[i] != w.pair_slope[j]:
        return bool(w.pair_slope[i] > w.pair_slope[j])
    if w.pair_a[i] != w.pair_a[j]:
        return bool(w.pair_a[i] < w.pair_a[j])
    return bool(w.pair_b[i] < w.pair_b[j])


@inner_kernel
def _swap(w: Work, i: int, j: int) -> None:
    """Exchange two rows of the table of borders."""
    w.pair_a[i], w.pair_a[j] = w.pair_a[j], w.pair_a[i]
    w.pair_b[i], w.pair_b[j] = w.pair_b[j], w.pair_b[i]
    w.pair_saddle[i], w.pair_saddle[j] = w.pair_saddle[j], w.pair_saddle[i]
    w.pair_slope[i], w.pair_slope[j] = w.pair_slope[j], w.pair_slope[i]


@inner_kernel
def _note_border(
    patch: Ints,
    p: Floats,
    label: Ints,
    pair_a: Ints,
    pair_b: Ints,
    pair_saddle: Floats,
    pair_slope: Floats,
    i: int,
    j: int,
    known: int,
    n_pairs: int,
) -> int:
    """Note that the clusters of tactels i and j border on each other; return the number of pairs."""
    if patch[j] <= patch[i] or label[j] < 0:
        return n_pairs
    a, b = label[i], label[j]
    saddle, slope = min(p[i], p[j]), max(p[i], p[j])
    for o in range(known, n_pairs):
        if pair_a[o] == a and pair_b[o] == b:
            if saddle > pair_saddle[o] or (saddle == pair_saddle[o] and slope > pair_slope[o]):
                pair_saddle[o], pair_slope[o] = saddle, slope
            return n_pairs
    if n_pairs == len(pair_a):
        return n_pairs
    pair_a[n_pairs], pair_b[n_pairs], pair_saddle[n_pairs], pair_slope[n_pairs] = a, b, saddle, slope
    return n_pairs + 1


@inner_kernel
def merge_clusters(lay: Layout, w: Work, n_clusters: int) -> None:
    """Give clusters of one contact one root in ``cluster_root``."""
    n_pairs = list_borders(lay, w, n_clusters)
    for o in range(n_pairs):
        a = find_root(w.cluster_root, w.pair_a[o])
        b = find_root(w.cluster_root, w.pair_b[o])
        if a == b:
            continue
        peak_a, peak_b = w.cluster_peak[a], w.cluster_peak[b]
        if w.p[peak_a] < w.p[peak_b]:
            a, b, peak_a, peak_b = b, a, peak_b, peak_a
        depth = w.p[peak_b] - w.pair_saddle[o]
        if depth > STANDS_OUT * lay.sigma[peak_b] and depth > DIP * w.p[peak_b]:
            continue
        if one_explains_both(lay, w, n_clusters, a, b):
            w.cluster_root[b] = a
            w.cluster_joined[a] = True
            w.cluster_hurried[a] |= w.cluster_hurried[b]


@inner_kernel
def one_explains_both(lay: Layout, w: Work, n_clusters: int, a: int, b: int) -> bool:
    """Return whether one contact explains the tactels of roots a and b as well as two do.

    When the budget is used up, that there is no valley between them is enough, and both are marked.
    """
    if is_over(w):
        w.cluster_hurried[a] = w.cluster_hurried[b] = True
        return True
    link = lay.patch_link[w.cluster_patch[a]]
    p, state, label, root_of, patch_of = w.p, w.state, w.label, w.cluster_root, w.cluster_patch
    listed, weight, background, owner = w.list, w.weight, w.background, w.owner
    sigma = lay.sigma
    describe(lay, w, n_clusters, a, b, runtime_int(0))
    peak = max(p[w.cluster_peak[a]], p[w.cluster_peak[b]])
    law = lay.law[w.cluster_peak[a]]
    spill = SPILL * min(peak_pressure(lay.law_par, lay.law_table, law, w.theta[0, 2]), SPILL_MOST * peak)
    n, last = runtime_int(0), -1
    for c in range(n_clusters):
        # clusters are in the order of their patches: each patch is listed once
        root = find_root(root_of, c)
        if root not in (a, b) or patch_of[c] == last:
            continue
        last = patch_of[c]
        for i in range(lay.patch_start[last], lay.patch_start[last + 1]):
            if state[i] == NO_VALUE:
                continue
            owner[n] = -1
            if label[i] >= 0:
                root = find_root(root_of, label[i])
                if root not in (a, b):
                    continue
                if p[i] >= OWNED * peak or p[i] >= CLEAR * sigma[i]:
                    owner[n] = 0
            misfit = MISFIT * p[i]
            weight[n] = 1.0 / (sigma[i] * sigma[i] + misfit * misfit + spill * spill)
            background[n] = 0.0
            list_place(lay, w, n, i)
            n += 1

    limit = runtime_int(MERGE_ITERATIONS)
    chi2_one, beat = 0.0, math.inf
    for k in range(1, 3):
        if k == 2:
            describe(lay, w, n_clusters, a, a, k - 2)
            describe(lay, w, n_clusters, b, b, k - 1)
            for t in range(n):
                owner[t] = -1
                i = listed[t]
                if label[i] >= 0 and (p[i] >= OWNED * peak or p[i] >= CLEAR * sigma[i]):
                    owner[t] = 0 if find_root(root_of, label[i]) == a else 1
        chi2, _, _ = fit(lay, w, link, k, n, MAX_MOVE, limit, ROUGH, beat)
        if is_over(w):
            w.cluster_hurried[a] = w.cluster_hurried[b] = True
            return True
        if k == 1:
            chi2_one, beat = chi2, chi2 - WORTH
            if chi2_one <= WORTH:
                return True
        elif chi2_one <= chi2 + WORTH:
            return True
    return False


@inner_kernel
def list_members(lay: Layout, w: Work, n_clusters: int, a: int, b: int) -> int:
    """List the touched tactels of roots a and b in ``member``; return how many."""
    label, root_of, patch_of, member = w.label, w.cluster_root, w.cluster_patch, w.member
    n, last = 0, -1
    alone = a == b and not w.cluster_joined[a]
    for c in range(a if alone else 0, a + 1 if alone else n_clusters):
        root = find_root(root_of, c)
        if root not in (a, b) or patch_of[c] == last:
            continue
        last = patch_of[c]
        for i in range(lay.patch_start[last], lay.patch_start[last + 1]):
            if label[i] < 0:
                continue
            root = find_root(root_of, label[i])
            if root in (a, b):
                member[n] = i
                n += 1
    return n


@inner_kernel
def describe(lay: Layout, w: Work, n_clusters: int, a: int, b: int, row: int) -> tuple[int, int, float]:
    """Write (s, a, log F) of the tactels of roots a and b as one contact to row of ``theta``.

    Returns the number of tactels, the tactel of the largest pressure and sum (p/sigma)^2.
    """
    n = list_members(lay, w, n_clusters, a, b)
    p, member, tactel_s, tactel_a, tactel_law = w.p, w.member, lay.s, lay.a, lay.law
    sigma, theta = lay.sigma, w.theta
    link = lay.patch_link[w.cluster_patch[a]]
    surface = surface_of(lay.link, link)

    # pressure-weighted centroid on the surface, developed about the strongest tactel (eq. 4)
    peak = w.cluster_peak[a]
    if p[w.cluster_peak[b]] > p[peak]:
        peak = w.cluster_peak[b]
    s0, a0 = tactel_s[peak], tactel_a[peak]
    mass, x, y, evidence = 0.0, 0.0, 0.0, 0.0
    for t in range(n):
        i = member[t]
        xi, yi = develop(surface, tactel_s[i], tactel_a[i], a0)
        mass += p[i]
        x += p[i] * (xi - s0)
        y += p[i] * yi
        z = p[i] / sigma[i]
        evidence += z * z
    theta[row, 0], theta[row, 1] = undevelop(surface, s0 + x / mass, y / mass, a0)
    keep_on_boards(lay, w, link, n, theta[row])
    place_s, place_a = theta[row, 0], theta[row, 1]

    # the amplitude by the sum over the tactels that share the law of the strongest (eq. 10)
    law = tactel_law[peak]
    laws, tables = lay.law_par, lay.law_table
    top, bottom, floor = 0.0, 0.0, 0.0
    foot = SPILL * affine(laws, tables, law, 0.0)[0]  # there the law is wrong by as much as it is
    for t in range(n):
        i = member[t]
        if tactel_law[i] == law:
            d = distance(surface, place_s, place_a, tactel_s[i], tactel_a[i])
            g, h = affine(laws, tables, law, d)
            top += p[i] - h
            bottom += g
            floor += foot
    bottom = max(bottom, floor)
    log_force = LOG_FORCE_MIN
    if top > 0.0 and bottom > 0.0:
        log_force = log_force_of(laws, law, top / bottom)
    theta[row, 3] = 1.0
    theta[row, 2] = min(max(log_force, LOG_FORCE_MIN), LOG_FORCE_MAX)
    return n, peak, evidence


@inner_kernel
def keep_on_boards(lay: Layout, w: Work, link: int, n: int, place: Floats) -> None:
    """Bring a place (s, a) that is on no board of the n tactels in ``member`` to the nearest of them."""
    nearest, least, last = -1, math.inf, -1
    for t in range(n):
        patch = lay.patch[w.member[t]]
        if patch == last:
            continue
        last = patch
        away = off_board(lay, link, patch, place)
        if away < least:
            nearest, least = patch, away
        if least == 0.0:
            return
    onto_board(lay, link, nearest, place)


@inner_kernel
def write_contacts(lay: Layout, w: Work, n_clusters: int, least: float) -> None:
    """Write one contact for each root whose sum of (p/sigma)^2 is at least ``least``; set ``n_contacts``."""
    k = 0
    for c in range(n_clusters):
        if find_root(w.cluster_root, c) != c:
            continue
        n, peak, evidence = describe(lay, w, n_clusters, c, c, runtime_int(0))
        for t in range(n):
            if w.held[w.member[t]]:  # chance does not show twice what is as rare as a touch by noise
                evidence = max(evidence, EVIDENCE)
        if evidence < least:
            continue
        w.link[k] = lay.patch_link[lay.patch[peak]]
        w.s[k], w.a[k], w.log_force[k] = w.theta[0, 0], w.theta[0, 1], w.theta[0, 2]
        w.patch[k] = lay.patch[peak]
        w.n_tactels[k] = n
        w.level[k], w.status[k] = 0, 0
        w.quality[k] = OVER_BUDGET if w.cluster_hurried[c] else 0
        w.evidence[k] = evidence
        w.residual[k] = 0.0
        w.covariance[k] = 0.0
        w.width[k], w.width_sd[k] = 1.0, 0.0
        w.alive[k] = True
        k += 1
    w.n_contacts[0] = k
    for c in range(len(w.averaged)):  # of a contact that is added later, too
        w.averaged[c] = False
