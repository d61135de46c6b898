"""The moves of level ``full``: contacts merged, split, added and taken out of a table of contacts.

A table is (k, 3): s, a (m), log force. What a move makes is the start of a fit, not an answer.
"""

from __future__ import annotations

import math

from skinbus.estimate.fit import LOG_FORCE_MAX, LOG_FORCE_MIN
from skinbus.estimate.geometry import distance, wrap
from skinbus.estimate.kernel import kernel
from skinbus.estimate.lawkernel import affine, log_force_of
from skinbus.estimate.layout import Floats, Layout
from skinbus.estimate.workspace import SATURATED, Work

LONELY = 0.04
"""m: contacts further apart do not explain each other's tactels."""


@kernel
def copy_rows(source: Floats, to: Floats, k: int) -> None:
    """Copy the first k contacts of one table to another."""
    for c in range(k):
        for x in range(3):
            to[c, x] = source[c, x]


@kernel
def remove_row(theta: Floats, c: int, k: int) -> None:
    """Take contact c out of k: the last takes its place."""
    for x in range(3):
        theta[c, x] = theta[k - 1, x]


@kernel
def lonely(lay: Layout, w: Work, link: int, c: int, k: int) -> bool:
    """Return whether no other contact of ``best`` could explain the tactels of contact c."""
    best, links = w.best, lay.link
    for e in range(k):
        d = distance(
            links[link, 0], links[link, 1], links[link, 2], links[link, 3],
            best[c, 0], best[c, 1], best[e, 0], best[e, 1],
        )  # fmt: skip
        if e != c and d < LONELY:
            return False
    return True


@kernel
def disown(w: Work, n: int) -> None:
    """Take the owners from the listed tactels: starts of moves lie within reach of what they explain."""
    for t in range(n):
        w.owner[t] = -1


@kernel
def closest_pair(lay: Layout, w: Work, link: int, k: int) -> tuple[int, int]:
    """Return the two contacts of ``best`` that are nearest to each other."""
    best, links = w.best, lay.link
    pair, nearest = (0, 1), math.inf
    for u in range(k):
        for v in range(u + 1, k):
            d = distance(
                links[link, 0], links[link, 1], links[link, 2], links[link, 3],
                best[u, 0], best[u, 1], best[v, 0], best[v, 1],
            )  # fmt: skip
            if d < nearest:
                pair, nearest = (u, v), d
    return pair


@kernel
def merge_rows(lay: Layout, w: Work, link: int, u: int, v: int) -> None:
    """Make row u of ``theta`` the contact with the forces of u and v added, at their centre."""
    theta, period = w.theta, lay.link[link, 2]
    share = 1.0 / (1.0 + math.exp(theta[u, 2] - theta[v, 2]))  # of v in the sum of the forces
    theta[u, 0] += share * (theta[v, 0] - theta[u, 0])
    theta[u, 1] += share * wrap(theta[v, 1] - theta[u, 1], period)
    if share < 0.5:
        theta[u, 2] = min(theta[u, 2] - math.log1p(-share), LOG_FORCE_MAX)
    else:
        theta[u, 2] = min(theta[v, 2] - math.log(share), LOG_FORCE_MAX)


@kernel
def split_row(lay: Layout, w: Work, link: int, c: int, k: int, angle: float, offset: float) -> None:
    """Make contact c and new contact k of ``theta`` the halves of c, ``offset`` (m) either way."""
    theta, links = w.theta, lay.link
    stretch = 1.0
    if links[link, 1] != 0.0:  # metres of a per metre of surface at this s
        r = links[link, 0] + links[link, 1] * (theta[c, 0] - 0.5 * links[link, 3])
        stretch = links[link, 0] / max(r, 0.1 * links[link, 0])
    ds, da = offset * math.cos(angle), offset * stretch * math.sin(angle)
    theta[c, 2] = max(theta[c, 2] - math.log(2.0), LOG_FORCE_MIN)
    theta[k, 0], theta[k, 1], theta[k, 2] = theta[c, 0] - ds, theta[c, 1] - da, theta[c, 2]
    theta[c, 0] += ds
    theta[c, 1] += da


@kernel
def start_at(lay: Layout, w: Work, t: int, k: int) -> None:
    """Make row k of ``theta`` a contact right at listed tactel t, as strong as its residual."""
    i = w.list[t]
    law = lay.law[i]
    residual = max(w.p[i] - w.predicted[t], lay.sigma[i])
    g, h = affine(lay.law_par, lay.law_table, law, 0.0)
    w.theta[k, 0], w.theta[k, 1] = lay.s[i], lay.a[i]
    log_force = log_force_of(lay.law_par, law, (residual - h) / g)
    w.theta[k, 2] = min(max(log_force, LOG_FORCE_MIN), LOG_FORCE_MAX)


@kernel
def residual_peak(w: Work, n: int) -> int:
    """Return the listed tactel that reads most above the prediction, in standard deviations; -1 for none."""
    peak, most = -1, 0.0
    for t in range(n):
        z = (w.p[w.list[t]] - w.predicted[t]) * math.sqrt(w.weight[t])
        if z > most:
            peak, most = t, z
    return peak


@kernel
def rate_contacts(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Write to ``rate`` the chi^2 of the tactels nearest to each contact of ``theta``."""
    theta, links, rate = w.theta, lay.link, w.rate
    for c in range(k):
        rate[c] = 0.0
    for t in range(n):
        i = w.list[t]
        nearest, home = math.inf, 0
        for c in range(k):
            d = distance(
                links[link, 0], links[link, 1], links[link, 2], links[link, 3],
                theta[c, 0], theta[c, 1], lay.s[i], lay.a[i],
            )  # fmt: skip
            if d < nearest:
                nearest, home = d, c
        residual = w.p[i] - w.predicted[t]
        if w.state[i] == SATURATED:
            residual = max(residual, 0.0)
        rate[home] += w.weight[t] * residual * residual


@kernel
def residual_axis(lay: Layout, w: Work, link: int, c: int, n: int) -> float:
    """Return the direction (rad from s) in which the residuals around contact c stretch."""
    theta, links = w.theta, lay.link
    far = 0.0
    for law in range(len(lay.law_par)):
        far = max(far, w.far[c, law])
    ss, sa, aa = 0.0, 0.0, 0.0
    for t in range(n):
        i = w.list[t]
        ds = lay.s[i] - theta[c, 0]
        da = wrap(lay.a[i] - theta[c, 1], links[link, 2])
        if ds * ds + da * da < far * far:
            residual = w.p[i] - w.predicted[t]
            ss += residual * ds * ds
            sa += residual * ds * da
            aa += residual * da * da
    return 0.5 * math.atan2(2.0 * sa, ss - aa)
