"""The moves of level ``full``: contacts merged, split, added and taken out of a table of contacts.

A table is (k, 4): s, a (m), log force, width. What a move makes is the start of a fit, not an answer.
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.geometry import distance, surface_of, wrap
from skinbus.estimate.kernels.groups import clear_weak_owners
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.least_squares import LOG_FORCE_MAX, LOG_FORCE_MIN
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.jit import inner_kernel, runtime_int

ISOLATED = 0.04
"""m: contacts further apart do not explain each other's tactels."""


@inner_kernel
def copy_rows(source: Floats, to: Floats, k: int) -> None:
    """Copy the first k contacts of one table to another."""
    for c in range(k):
        for x in range(4):
            to[c, x] = source[c, x]


@inner_kernel
def remove_row(theta: Floats, c: int, k: int) -> None:
    """Take contact c out of k: the last takes its place."""
    for x in range(4):
        theta[c, x] = theta[k - 1, x]


@inner_kernel
def isolated(lay: Layout, w: Work, link: int, c: int, k: int) -> bool:
    """Return whether no other contact of ``best`` could explain the tactels of contact c."""
    best, surface = w.best, surface_of(lay.link, link)
    for e in range(k):
        d = distance(surface, best[c, 0], best[c, 1], best[e, 0], best[e, 1])
        if e != c and d < ISOLATED:
            return False
    return True


@inner_kernel
def clear_owners(w: Work, n: int) -> None:
    """Take their owners from the listed tactels: from here on the law is what it is."""
    for t in range(n):
        w.owner[t] = -1


@inner_kernel
def recentre(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Put every wide contact of ``theta`` to the centroid of its tactels, with the law's width."""
    theta, owner, listed, p = w.theta, w.owner, w.list, w.p
    surface = surface_of(lay.link, link)
    own_nearest(lay, w, link, k, n)
    for c in range(k):
        if theta[c, 3] == 1.0:
            continue
        mass, ds, da = 0.0, 0.0, 0.0
        for t in range(n):
            if owner[t] == c:
                i = listed[t]
                mass += p[i]
                ds += p[i] * (lay.s[i] - theta[c, 0])
                da += p[i] * wrap(lay.a[i] - theta[c, 1], surface.period)
        if mass > 0.0:
            theta[c, 0] += ds / mass
            theta[c, 1] += da / mass
        # a stretched law needs more force for the same pressure: about its square
        theta[c, 2] -= 2.0 * math.log(theta[c, 3])
        theta[c, 3] = 1.0


@inner_kernel
def own_nearest(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Make the nearest of k contacts in ``theta`` the owner of each touched tactel listed."""
    theta, owner, listed, active = w.theta, w.owner, w.list, w.active
    tactel_s, tactel_a = lay.s, lay.a
    surface = surface_of(lay.link, link)
    for t in range(n):
        i = listed[t]
        owner[t] = -1
        if not active[i]:
            continue
        nearest = math.inf
        for c in range(k):
            d = distance(surface, theta[c, 0], theta[c, 1], tactel_s[i], tactel_a[i])
            if d < nearest:
                nearest = d
                owner[t] = c
    clear_weak_owners(lay, w, k, n)


@inner_kernel
def closest_pair(lay: Layout, w: Work, link: int, k: int) -> tuple[int, int]:
    """Return the two contacts of ``best`` that are nearest to each other."""
    best, surface = w.best, surface_of(lay.link, link)
    pair, nearest = (0, 1), math.inf
    for u in range(k):
        for v in range(u + 1, k):
            d = distance(surface, best[u, 0], best[u, 1], best[v, 0], best[v, 1])
            if d < nearest:
                pair, nearest = (u, v), d
    return pair


@inner_kernel
def merge_rows(lay: Layout, w: Work, link: int, u: int, v: int) -> None:
    """Make row u of ``theta`` the contact with the forces of u and v added, at their centre."""
    theta, period = w.theta, surface_of(lay.link, link).period
    share = 1.0 / (1.0 + math.exp(theta[u, 2] - theta[v, 2]))  # of v in the sum of the forces
    theta[u, 3] = max(theta[u, 3], theta[v, 3])
    theta[u, 0] += share * (theta[v, 0] - theta[u, 0])
    theta[u, 1] += share * wrap(theta[v, 1] - theta[u, 1], period)
    if share < 0.5:
        theta[u, 2] = min(theta[u, 2] - math.log1p(-share), LOG_FORCE_MAX)
    else:
        theta[u, 2] = min(theta[v, 2] - math.log(share), LOG_FORCE_MAX)


@inner_kernel
def split_row(lay: Layout, w: Work, link: int, c: int, k: int, angle: float, offset: float) -> None:
    """Make contact c and new contact k of ``theta`` the halves of c, ``offset`` (m) either way."""
    theta, surface = w.theta, surface_of(lay.link, link)
    stretch = 1.0
    if surface.taper != 0.0:  # metres of a per metre of surface at this s
        r = surface.radius + surface.taper * (theta[c, 0] - 0.5 * surface.length)
        stretch = surface.radius / max(r, 0.1 * surface.radius)
    ds, da = offset * math.cos(angle), offset * stretch * math.sin(angle)
    theta[c, 2] = max(theta[c, 2] - math.log(2.0), LOG_FORCE_MIN)
    theta[k, 0], theta[k, 1], theta[k, 2] = theta[c, 0] - ds, theta[c, 1] - da, theta[c, 2]
    theta[c, 0] += ds
    theta[c, 1] += da
    theta[c, 3], theta[k, 3] = 1.0, 1.0


@inner_kernel
def rate_contacts(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Write to ``rate`` the chi^2 of the tactels nearest to each contact of ``theta``."""
    theta, rate, surface = w.theta, w.rate, surface_of(lay.link, link)
    for c in range(k):
        rate[c] = 0.0
    for t in range(n):
        i = w.list[t]
        nearest, home = math.inf, 0
        for c in range(k):
            d = distance(surface, theta[c, 0], theta[c, 1], lay.s[i], lay.a[i])
            if d < nearest:
                nearest, home = d, c
        residual = w.p[i] - w.predicted[t]
        if w.state[i] == SATURATED:
            residual = max(residual, 0.0)
        rate[home] += w.weight[t] * residual * residual


@inner_kernel
def residual_axis(lay: Layout, w: Work, link: int, c: int, n: int) -> float:
    """Return the direction (rad from s) in which the residuals around contact c stretch."""
    theta, surface = w.theta, surface_of(lay.link, link)
    far = w.far[c]
    ss, sa, aa = 0.0, 0.0, 0.0
    for t in range(n):
        i = w.list[t]
        ds = lay.s[i] - theta[c, 0]
        da = wrap(lay.a[i] - theta[c, 1], surface.period)
        if ds * ds + da * da < far * far:
            residual = w.p[i] - w.predicted[t]
            ss += residual * ds * ds
            sa += residual * ds * da
            aa += residual * da * da
    return 0.5 * math.atan2(2.0 * sa, ss - aa)


@inner_kernel
def resize_group(w: Work, first: int, k_before: int, k: int, link: int) -> None:
    """Give a group of k_before contacts room for k: take back the last, or append."""
    members = w.members
    for c in range(k, k_before):
        w.alive[members[c]] = False
    for c in range(k_before, k):
        to = w.n_contacts[0]
        w.n_contacts[0] = to + 1
        members[c] = to
        w.alive[to], w.group[to], w.link[to] = True, first, link
        w.group_size[first] += 1
        w.quality[to], w.evidence[to] = w.quality[first], w.evidence[first]


@inner_kernel
def close_gaps(w: Work) -> None:
    """Close the gaps that contacts taken back have left in the columns."""
    kept = runtime_int(0)
    for c in range(w.n_contacts[0]):
        if w.alive[c]:
            copy_contact(w, c, kept)
            w.alive[kept] = True
            kept += 1
    w.n_contacts[0] = kept


@inner_kernel
def copy_contact(w: Work, source: int, to: int) -> None:
    """Copy the columns of one contact to an earlier place."""
    if source == to:
        return
    w.width[to], w.evidence[to], w.wider_by[to] = w.width[source], w.evidence[source], w.wider_by[source]
    w.link[to], w.s[to], w.a[to], w.log_force[to] = (
        w.link[source],
        w.s[source],
        w.a[source],
        w.log_force[source],
    )
    w.patch[to], w.n_tactels[to], w.level[to] = w.patch[source], w.n_tactels[source], w.level[source]
    w.quality[to], w.status[to], w.residual[to] = w.quality[source], w.status[source], w.residual[source]
    w.integrated[to], w.averaged[to] = w.integrated[source], w.averaged[source]
    for x in range(3):
        w.mean[to, x] = w.mean[source, x]
        for y in range(3):
            w.covariance[to, x, y] = w.covariance[source, x, y]
            w.mean_covariance[to, x, y] = w.mean_covariance[source, x, y]
