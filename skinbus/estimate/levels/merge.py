"""One contact across seams, with its force by the contact law.

Two clusters that border on each other across a seam are one contact if there is no valley between them:
pressure
does not fall, on the way from the lower maximum to the higher one, by more than noise and spread of gains
make it (the rule of ``kmeans``). Borders are tried from the highest saddle down, so that four patches at a
corner, or a contact as wide as a ring of patches, come together one by one. Distances wrap with the surface.

The force of a contact inverts the law (paper, eq. 10, 5, 6) in the sum over its tactels: the amplitude A with
which sum (A g_j + h_j) is the pressure that they read. For the cone it is the mean of H_j = p_j + S d_j.
Errors of the centroid raise some terms and lower those opposite, and the sum of a law over a grid hardly
depends on where in the grid it stands. On the corner of four boards, where all feel less than ``SPILL``
of the peak, its force is not determined: there the law counts as that much.

Failure: two contacts on both sides of a seam without a valley between them are one here; the search divides
them.
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.board_places import off_board, onto_board
from skinbus.estimate.kernels.geometry import develop, distance, surface_of, undevelop
from skinbus.estimate.kernels.law import log_force_of, pressure
from skinbus.estimate.kernels.layout import Floats, Ints, Layout
from skinbus.estimate.kernels.workspace import NO_VALUE, Work
from skinbus.estimate.levels.kmeans import DIP, STANDS_OUT, find_root
from skinbus.jit import inner_kernel, runtime_int

SPILL = 0.05
"""Part of the pressure under a contact by which a law is wrong elsewhere: the foot of a real field."""
LOG_FORCE_MIN, LOG_FORCE_MAX = -46.0, 46.0
"""1e-20 N to 1e20 N: any skin is inside, and no power of it leaves the range of floats."""
EVIDENCE = 42.0
"""Sum of (p/sigma)^2 below which a contact is taken for noise: 6.5 sigma on one tactel, which 384 tactels
show by chance once in 5e7 cycles."""
FAINT_EVIDENCE = 18.0
"""The same from which a fit is tried: two tactels that feel something."""


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
        w.cluster_root[b] = a
        w.cluster_joined[a] = True


@inner_kernel
def list_members(lay: Layout, w: Work, n_clusters: int, root: int) -> int:
    """List the touched tactels of a root in ``member``; return how many."""
    label, root_of, patch_of, member = w.label, w.cluster_root, w.cluster_patch, w.member
    n, last = 0, -1
    alone = not w.cluster_joined[root]
    for c in range(root if alone else 0, root + 1 if alone else n_clusters):
        # clusters are in the order of their patches: each patch is listed once
        if find_root(root_of, c) != root or patch_of[c] == last:
            continue
        last = patch_of[c]
        for i in range(lay.patch_start[last], lay.patch_start[last + 1]):
            if label[i] >= 0 and find_root(root_of, label[i]) == root:
                member[n] = i
                n += 1
    return n


@inner_kernel
def describe(lay: Layout, w: Work, n_clusters: int, root: int, place: Floats) -> tuple[int, int, float]:
    """Write (s, a, log F) of the tactels of a root as one contact to ``place``.

    Returns the number of tactels, the tactel of the largest pressure and sum (p/sigma)^2.
    """
    n = list_members(lay, w, n_clusters, root)
    p, member, tactel_s, tactel_a, tactel_law, sigma = w.p, w.member, lay.s, lay.a, lay.law, lay.sigma
    link, peak = lay.patch_link[w.cluster_patch[root]], w.cluster_peak[root]
    surface = surface_of(lay.link, link)

    # pressure-weighted centroid on the surface, developed about the strongest tactel (eq. 4)
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
    place[0], place[1] = undevelop(surface, s0 + x / mass, y / mass, a0)
    keep_on_boards(lay, w, link, n, place)

    # the amplitude by the sum over the tactels that share the law of the strongest (eq. 10)
    law = tactel_law[peak]
    laws, tables = lay.law_par, lay.law_table
    foot = SPILL * pressure(laws, tables, law, 1.0, 0.0)[2]  # there the law is wrong by as much as it is
    top, bottom, floor = 0.0, 0.0, 0.0
    for t in range(n):
        i = member[t]
        if tactel_law[i] == law:
            d = distance(surface, place[0], place[1], tactel_s[i], tactel_a[i])
            unit, _, g = pressure(laws, tables, law, 1.0, d)  # p = A g + h
            top += p[i] - (unit - g)
            bottom += g
            floor += foot
    bottom = max(bottom, floor)
    log_force = LOG_FORCE_MIN
    if top > 0.0 and bottom > 0.0:
        log_force = log_force_of(laws, law, top / bottom)
    place[2], place[3] = min(max(log_force, LOG_FORCE_MIN), LOG_FORCE_MAX), 0.0
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
        n, peak, evidence = describe(lay, w, n_clusters, c, w.place[k])
        is_held = False
        for t in range(n):
            is_held |= w.held[w.member[t]]
        if evidence < least and not is_held:  # chance does not show twice what is as rare as a touch by noise
            continue
        w.link[k] = lay.patch_link[lay.patch[peak]]
        w.patch[k] = lay.patch[peak]
        w.n_tactels[k] = n
        w.level[k], w.status[k] = 0, 0
        w.quality[k] = 0
        w.proof[k] = 2 if is_held else 1 if evidence >= EVIDENCE else 0
        w.residual[k] = 0.0
        w.covariance[k] = 0.0
        w.alive[k] = True
        k += 1
    w.n_contacts[0] = k
