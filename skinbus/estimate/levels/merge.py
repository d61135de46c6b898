"""One contact across seams, with its force by the contact law.

Two clusters that border on each other across a seam are one contact if there is no valley between them:
pressure does not fall, on the way from the lower maximum to the higher one, by more than noise and spread of
gains make it (the rule of ``kmeans``). Borders are tried from the highest saddle down, so that four patches
at a corner, or a contact as wide as a ring of patches, come together one by one. Distances wrap with the
surface.

The force of a contact inverts the law (paper, eq. 10, 5, 6) in the sum over its tactels: the amplitude A with
which sum (A g_j + h_j) is the pressure that they read. For the cone it is the mean of H_j = p_j + S d_j.
An error of the centroid raises some terms and lowers those opposite, and the sum of a law over a grid hardly
depends on its place in the grid. On the corner of four boards all tactels feel less than ``CORE_PART`` of the
peak, and do not determine the force: there the mean of g_j counts as that much.

Failure: two contacts on both sides of a seam without a valley between them are one here; the search divides
them.
"""

from __future__ import annotations

from skinbus.arrays import Floats
from skinbus.estimate.kernels.board_places import keep_on_board
from skinbus.estimate.kernels.geometry import develop, distance, surface_of, undevelop
from skinbus.estimate.kernels.law import log_force_of, pressure
from skinbus.estimate.kernels.layout import CORE_PART, OWN_SIZE, PEAK, Layout
from skinbus.estimate.kernels.workspace import NO_VALUE, Work
from skinbus.estimate.levels.kmeans import find_root, stands_out
from skinbus.jit import inner_kernel, runtime_int

LOG_FORCE_MIN, LOG_FORCE_MAX = -46.0, 46.0
"""1e-20 N to 1e20 N: any skin is inside, and no power of it leaves the range of floats."""
EVIDENCE = 42.0
"""Sum of (p/sigma)^2 below which a contact is taken for noise: 6.5 sigma on one tactel, which 384 tactels
show by chance once in 5e7 cycles."""


@inner_kernel
def list_borders(lay: Layout, w: Work) -> int:
    """Write where clusters of different patches meet to ``border``, highest saddle first; return how many."""
    n = runtime_int(0)
    for patch in range(len(w.touched)):
        for i in range(lay.patch_start[patch], lay.patch_start[patch + 1] if w.touched[patch] else 0):
            for e in range(lay.edge_start[i], lay.edge_start[i + 1] if w.label[i] >= 0 else 0):
                j = lay.edge_to[e]
                if w.state[j] != NO_VALUE:
                    n = note_border(lay, w, i, j, n)
                    continue
                for f in range(lay.edge_start[j], lay.edge_start[j + 1]):
                    n = note_border(lay, w, i, lay.edge_to[f], n)
    return n


@inner_kernel
def note_border(lay: Layout, w: Work, i: int, j: int, n: int) -> int:
    """Insert tactels i and j into the list of n borders, unless a valley divides them; return its new length.

    At a corner one tactel may be the saddle to two patches: then the higher tactel beside it comes first,
    whatever the numbers of the patches.
    """
    p, border, label = w.p, w.border, w.label
    if lay.patch[j] <= lay.patch[i] or label[j] < 0 or n == len(border):
        return n
    saddle, slope, a, b = min(p[i], p[j]), max(p[i], p[j]), w.cluster_peak[label[i]], w.cluster_peak[label[j]]
    # merged clusters have higher peaks, so the valley divides them, too
    if stands_out(lay, w, a if p[a] < p[b] else b, saddle):
        return n
    o = runtime_int(n)
    while o > 0:
        u, v = border[o - 1, 0], border[o - 1, 1]
        low = min(p[u], p[v])
        if low > saddle or (low == saddle and max(p[u], p[v]) >= slope):
            break
        border[o, 0], border[o, 1] = u, v
        o -= 1
    border[o, 0], border[o, 1] = i, j
    return n + 1


@inner_kernel
def merge_clusters(lay: Layout, w: Work, n_clusters: int) -> None:
    """Give clusters of one contact one root in ``cluster_root``, and list the tactels of each root.

    The first is in ``first_of``, the next in ``next_of``, up to -1.
    """
    p, peak, root_of, label = w.p, w.cluster_peak, w.cluster_root, w.label
    for o in range(list_borders(lay, w)):
        i, j = w.border[o, 0], w.border[o, 1]
        a, b = find_root(root_of, label[i]), find_root(root_of, label[j])
        if p[peak[a]] < p[peak[b]]:
            a, b = b, a
        if a != b and not stands_out(lay, w, peak[b], min(p[i], p[j])):
            root_of[b] = a
    for c in range(n_clusters):
        w.first_of[c] = -1
    for i in range(len(label) - 1, -1, -1):
        if label[i] >= 0:
            root = find_root(root_of, label[i])
            w.next_of[i], w.first_of[root] = w.first_of[root], i


@inner_kernel
def describe(lay: Layout, w: Work, root: int, place: Floats) -> tuple[int, int, float]:
    """Write (s, a, log F) of the tactels of a root as one contact to ``place``, the tactels to ``member``.

    Returns the number of tactels, the tactel of the largest pressure and sum (p/sigma)^2.
    """
    p, member, tactel_s, tactel_a = w.p, w.member, lay.s, lay.a
    peak = w.cluster_peak[root]
    link = lay.patch_link[lay.patch[peak]]
    surface = surface_of(lay.link, link)

    # pressure-weighted centroid on the surface, developed about the strongest tactel (eq. 4)
    s0, a0 = tactel_s[peak], tactel_a[peak]
    mass, x, y, evidence, n, i = 0.0, 0.0, 0.0, 0.0, 0, w.first_of[root]
    while i >= 0:
        member[n] = i
        xi, yi = develop(surface, tactel_s[i], tactel_a[i], a0)
        mass += p[i]
        x += p[i] * (xi - s0)
        y += p[i] * yi
        z = p[i] / lay.sigma[i]
        evidence += z * z
        n, i = n + 1, w.next_of[i]
    place[0], place[1] = undevelop(surface, s0 + x / mass, y / mass, a0)
    keep_on_board(lay, link, member, n, place)

    # the amplitude by the sum over the tactels that share the law of the strongest (eq. 10)
    law = lay.law[peak]
    laws, tables = lay.law_par, lay.law_table
    size = laws[law, OWN_SIZE]
    foot = CORE_PART * laws[law, PEAK]  # below it the law errs by its own value
    top, bottom, floor = 0.0, 0.0, 0.0
    for t in range(n):
        i = member[t]
        if lay.law[i] == law:
            d = distance(surface, place[0], place[1], tactel_s[i], tactel_a[i])
            unit, _, g, _ = pressure(laws, tables, law, 1.0, d, size)  # p = A g + h
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
def write_contacts(lay: Layout, w: Work, n_clusters: int) -> None:
    """Write one contact for each root whose sum of (p/sigma)^2 is enough; set ``n_contacts``."""
    k = 0
    for c in range(n_clusters):
        if w.first_of[c] < 0:
            continue
        n, peak, evidence = describe(lay, w, c, w.place[k])
        is_held = False
        for t in range(n):
            is_held |= w.held[w.member[t]]
        if evidence < EVIDENCE and not is_held:  # noise hardly touches in two cycles in a row
            continue
        w.link[k] = lay.patch_link[lay.patch[peak]]
        w.patch[k] = lay.patch[peak]
        w.n_tactels[k] = n
        w.level[k] = w.status[k] = w.quality[k] = 0
        w.residual[k] = 0.0
        w.covariance[k] = 0.0
        w.alive[k] = True
        k += 1
    w.n_contacts[0] = k
