"""Weighted K-means of one patch: its touched tactels, split among the places they seem to be touched at.

::

    S_i = { x_j : |x_j - m_i| <= |x_j - m_i*| for every i* }            (paper, eq. 2)
    m_i = sum_{j in S_i} w_j x_j,  w_j = p_j / sum_{j in S_i} p_j       (eq. 4, weights normalised)

Start and K: the local maxima of the pressure on the neighbourhood graph that stand out of it: one has
to go down by ``STANDS_OUT`` of the noise, and by ``DIP`` of the maximum, before going up to a higher one
(persistence). The paper's random start is here too. A tactel without a value is stepped over.

Assumption: pressure falls with distance from a contact. Failure: contacts so near that their fields
show one maximum become one cluster, which only the fit can divide.
Source: the paper, section IV; H. Edelsbrunner, J. Harer, Computational Topology (2010), VII.
"""

from __future__ import annotations

import math

from skinbus.arrays import Ints
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.workspace import NO_VALUE, PATCH_CLUSTERS, Work
from skinbus.jit import inner_kernel, runtime_int

STANDS_OUT = 6.0
"""Standard deviations of a reading that a maximum must be above the saddle: 4.2 of their difference, which
chance shows once in 10^5 times."""
DIP = 0.1
"""Share of a maximum that it must be above the saddle: gains, which scatter by a few per cent, make none."""
MAX_ROUNDS = 64
"""Bound on the rounds of K-means, which ends in fewer than ten with 64 points."""


@inner_kernel
def cluster_patch(lay: Layout, w: Work, patch: int, first: int, k_wanted: int, random: bool) -> int:
    """Cluster the active tactels of a patch into columns ``first``...; return the number of clusters.

    ``k_wanted`` 0 chooses K by the maxima. ``random`` starts from K random active tactels instead. Clusters
    may end without tactels.
    """
    i0, i1 = lay.patch_start[patch], lay.patch_start[patch + 1]
    k = find_maxima(lay, w, i0, i1, k_wanted)
    if random:
        k = draw_starts(w, i0, i1, k if k_wanted == 0 else k_wanted)
    elif k < k_wanted:
        k = add_far_starts(lay, w, i0, i1, k, k_wanted)
    for c in range(k):
        w.cluster_x[first + c] = lay.x[w.starts[c]]
        w.cluster_y[first + c] = lay.y[w.starts[c]]
    assign_and_average(lay, w, i0, i1, first, k)
    label, peak = w.label, w.cluster_peak
    for c in range(first, first + k):
        peak[c], w.cluster_root[c] = -1, c
    for i in range(i0, i1):
        if label[i] >= 0:
            label[i] += first
            if peak[label[i]] < 0 or w.p[i] > w.p[peak[label[i]]]:
                peak[label[i]] = i
    return k


@inner_kernel
def find_root(parent: Ints, i: int) -> int:
    """Return the root of i in a union-find forest, halving the path on the way."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@inner_kernel
def find_maxima(lay: Layout, w: Work, i0: int, i1: int, k_wanted: int) -> int:
    """Write the maxima that stand out, highest first, to ``starts``; return how many.

    At most ``k_wanted``, if that is not 0. Tactels are visited from the highest down, and joined to the peaks
    of their neighbours. The root of a peak is its maximum. Where two peaks meet, the lower one ends; it is
    kept if its maximum stands out of this saddle.
    """
    p, state, parent, order, edge_start, edge_to = (
        w.p,
        w.state,
        w.parent,
        w.order,
        lay.edge_start,
        lay.edge_to,
    )
    n = 0
    for i in range(i0, i1):
        parent[i] = -1
        if state[i] != NO_VALUE:
            # insertion sort: the list is short and nearly always has one peak
            j = n
            while j > 0 and p[order[j - 1]] < p[i]:
                order[j] = order[j - 1]
                j -= 1
            order[j] = i
            n += 1
    k = runtime_int(0)
    for o in range(n):
        i = order[o]
        parent[i] = i
        for e in range(edge_start[i], edge_start[i + 1]):
            j = edge_to[e]
            if j < i0 or j >= i1:
                continue
            if state[j] != NO_VALUE:
                k = join(lay, w, i, j, k)
                continue
            for f in range(edge_start[j], edge_start[j + 1]):
                j2 = edge_to[f]
                if i0 <= j2 < i1 and state[j2] != NO_VALUE:
                    k = join(lay, w, i, j2, k)
    # peaks that met no higher one; if none is touched, the touched tactels below them
    for o in range(n):
        i = order[o]
        if w.active[i] and (parent[i] == i or k == 0):
            k = keep(w, i, k)
    return min(k, k_wanted) if k_wanted > 0 else k


@inner_kernel
def join(lay: Layout, w: Work, i: int, j: int, k: int) -> int:
    """Join the peaks of i, which is visited now, and of its neighbour j; return the number of maxima kept."""
    p, parent = w.p, w.parent
    if parent[j] < 0:
        return k
    high, low = find_root(parent, j), find_root(parent, i)
    if high == low:
        return k
    if p[high] < p[low] or (p[high] == p[low] and high > low):
        high, low = low, high
    parent[low] = high
    return keep(w, low, k) if low != i and w.active[low] and stands_out(lay, w, low, p[i]) else k


@inner_kernel
def stands_out(lay: Layout, w: Work, i: int, saddle: float) -> bool:
    """Return whether tactel i is far enough above a saddle (Pa): by more than noise and gains make it."""
    depth = w.p[i] - saddle
    return bool(depth > STANDS_OUT * lay.sigma[i] and depth > DIP * w.p[i])


@inner_kernel
def keep(w: Work, i: int, k: int) -> int:
    """Insert maximum i into the list of k starts, highest first; return the new length."""
    p, starts, j = w.p, w.starts, min(k, PATCH_CLUSTERS - 1)
    if k == PATCH_CLUSTERS and p[starts[j]] >= p[i]:
        return k
    while j > 0 and p[starts[j - 1]] < p[i]:
        starts[j] = starts[j - 1]
        j -= 1
    starts[j] = i
    return min(k + 1, PATCH_CLUSTERS)


@inner_kernel
def draw_starts(w: Work, i0: int, i1: int, k: int) -> int:
    """Write k distinct random active tactels to ``starts``; return how many (paper, section IV)."""
    n = 0
    for i in range(i0, i1):
        if w.active[i]:
            w.order[n] = i
            n += 1
    k = min(k, n, PATCH_CLUSTERS)
    for c in range(k):
        # Park-Miller generator: exact in 64-bit integers, the same bits with and without compilation
        w.random[0] = w.random[0] * 48271 % 2147483647
        pick = c + w.random[0] % (n - c)
        w.order[c], w.order[pick] = w.order[pick], w.order[c]
        w.starts[c] = w.order[c]
    return k


@inner_kernel
def add_far_starts(lay: Layout, w: Work, i0: int, i1: int, k: int, k_wanted: int) -> int:
    """Add the active tactel furthest from all starts until there are k_wanted; return how many there are."""
    while k < min(k_wanted, PATCH_CLUSTERS):
        best, furthest = -1, 0.0
        for i in range(i0, i1):
            if not w.active[i]:
                continue
            nearest = math.inf
            for c in range(k):
                dx, dy = lay.x[i] - lay.x[w.starts[c]], lay.y[i] - lay.y[w.starts[c]]
                nearest = min(nearest, dx * dx + dy * dy)
            if nearest > furthest:
                best, furthest = i, nearest
        if best < 0:
            break
        w.starts[k] = best
        k += 1
    return k


@inner_kernel
def assign_and_average(lay: Layout, w: Work, i0: int, i1: int, first: int, k: int) -> None:
    """Repeat eq. 2 and eq. 4 until no tactel changes its cluster; labels count from 0 within the patch."""
    p, active, label, x, y = w.p, w.active, w.label, lay.x, lay.y
    mean_x, mean_y = w.cluster_x[first : first + k], w.cluster_y[first : first + k]
    for _ in range(MAX_ROUNDS):
        changed = False
        for i in range(i0, i1):
            if not active[i]:
                continue
            best, nearest = 0, math.inf
            for c in range(k):
                dx, dy = x[i] - mean_x[c], y[i] - mean_y[c]
                if dx * dx + dy * dy < nearest:
                    best, nearest = c, dx * dx + dy * dy
            if label[i] != best:
                label[i] = best
                changed = True
        if not changed:
            break
        for c in range(k):
            mass, sum_x, sum_y = 0.0, 0.0, 0.0
            for i in range(i0, i1):
                # relative to the last centroid, so that a patch far from the origin loses no digits
                own = p[i] if label[i] == c else 0.0
                mass += own
                sum_x += own * (x[i] - mean_x[c])
                sum_y += own * (y[i] - mean_y[c])
            if mass > 0.0:
                mean_x[c] += sum_x / mass
                mean_y[c] += sum_y / mass
