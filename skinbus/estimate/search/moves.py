"""The moves from one hypothesis to others: sizes, places, fewer contacts, more contacts.

Each move proposes to replace up to two contacts of a hypothesis by up to two others. The new ones come first
in ``theta``: they are fitted alone at first, then all together, by ``consider``.
"""

from __future__ import annotations

import math
from typing import Final

from skinbus.estimate.kernels.geometry import distance, surface_of, wrap
from skinbus.estimate.kernels.law import amplitude, log_force_at, pressure
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.workspace import GROUP, KINDS, Search, Work
from skinbus.estimate.search.evidence import (
    RIVAL,
    TRY,
    consider,
    misfit,
    prepare,
)
from skinbus.estimate.search.least_squares import invert, keep_on_board
from skinbus.jit import inner_kernel

FELT, ENOUGH = 3.0, 4
"""A tactel feels a contact by so many standard deviations; with so many such tactels there is one mode."""
AROUND, DIRECTIONS = 0.6, 5
"""Pitches at which places around a contact are tried, and how many. Mirror places complete them."""
SAME: Final = 0.1
"""Pitches below which a place is no other."""
EVIDENT: Final = 16.0
"""chi^2 from which on another contact can gain more than it costs."""
SQUEEZE, SQUEEZED = 0.25, 0.3
"""Part of their distance by which a pair is brought together, and log force that it gains by that."""
SPLITS: Final = (0.5, 1.0)
"""Pitches from the middle at which a contact is divided into two."""
BESIDE: Final = 3.0
"""Pitches around a contact in which residuals say along which line it divides."""


@inner_kernel
def expand(lay: Layout, w: Work, q: Search, link: int, h: int, full: bool) -> None:
    """Fit what the moves propose from hypothesis h."""
    prepare(lay, w, q, link, h)
    invert(q, q.dof[0] * q.h_count[h])
    thorough = full or misfit(q, h) > 1.0
    q.n_plans[0] = 0
    if q.dof[0] == 4:
        propose_sizes(q, h)
    propose_places(lay, q, link, h, thorough)
    if q.h_count[h] > 1:
        propose_fewer(lay, q, link, h)
        if full:
            propose_pair(lay, q, link, h)
    if thorough and q.h_chi2[h, 0] > EVIDENT and q.h_count[h] < GROUP:
        propose_more(lay, q, link, h)
    for move in range(q.n_plans[0]):
        free = int(q.plan[move, 2])
        k = free
        for c in range(free):
            q.kind[c] = int(q.plan[move, 3 + 5 * c])
            for x in range(4):
                q.theta[c, x] = q.plan[move, 4 + 5 * c + x]
            q.theta[c, 1] = wrap(q.theta[c, 1], surface_of(lay.link, link).period)
            keep_on_board(lay, q, link, q.theta[c])
        for c in range(q.h_count[h]):
            if c != int(q.plan[move, 0]) and c != int(q.plan[move, 1]):
                q.kind[k] = q.h_kind[h, c]
                for x in range(4):
                    q.theta[k, x] = q.h_theta[h, c, x]
                k += 1
        consider(lay, w, q, link, k, free)


@inner_kernel
def propose(q: Search, gone: int, also: int, n_new: int) -> int:
    """Add a proposal to replace contacts ``gone`` and ``also`` (-1 for none) by new ones; return its row."""
    row = q.n_plans[0]
    q.n_plans[0] += 1
    q.plan[row, 0], q.plan[row, 1], q.plan[row, 2] = gone, also, n_new
    return int(row)


@inner_kernel
def put(q: Search, row: int, c: int, kind: int, s: float, a: float, log_force: float, size: float) -> None:
    """Write new contact c of a proposal."""
    to = 3 + 5 * c
    q.plan[row, to], q.plan[row, to + 1], q.plan[row, to + 2] = kind, s, a
    q.plan[row, to + 3], q.plan[row, to + 4] = log_force, size


@inner_kernel
def propose_sizes(q: Search, h: int) -> None:
    """Propose other kinds of size for each contact, where the fit as it is predicts that they are not
    refuted.

    The readings alone say u ~ N(m, v), the fit less its prior. A kind N(u_k, s_k^2) has then the evidence
    N(m; u_k, v + s_k^2), and moves the other parameters by their covariance with u.
    """
    floor = -RIVAL if misfit(q, h) <= 1.0 else -TRY
    for c in range(q.h_count[h]):
        u, own = 4 * c, q.kind[c]
        variance, size, own_variance = q.inverse[u + 3, u + 3], q.theta[c, 3], q.kind_sd[own] ** 2
        precision = max(1.0 / variance - 1.0 / own_variance, 1e-9)
        data = (size / variance - q.kind_mean[own] / own_variance) / precision
        total, off = own_variance + 1.0 / precision, data - q.kind_mean[own]
        here = -0.5 * (math.log(total) + off * off / total) + math.log(q.kind_share[own])
        for kind in range(KINDS):
            if kind == own or q.kind_share[kind] == 0.0:
                continue
            other = q.kind_sd[kind] ** 2
            total, off = other + 1.0 / precision, data - q.kind_mean[kind]
            if -0.5 * (math.log(total) + off * off / total) + math.log(q.kind_share[kind]) < here + floor:
                continue
            wanted = (precision * data + q.kind_mean[kind] / other) / (precision + 1.0 / other)
            by, row = (wanted - size) / variance, propose(q, c, -1, 1)
            put(
                q,
                row,
                0,
                kind,
                q.theta[c, 0] + by * q.inverse[u, u + 3],
                q.theta[c, 1] + by * q.inverse[u + 1, u + 3],
                q.theta[c, 2] + by * q.inverse[u + 2, u + 3],
                wanted,
            )


@inner_kernel
def propose_places(lay: Layout, q: Search, link: int, h: int, around: bool) -> None:
    """Propose other places for each contact that is not certain: over its nearest tactels, and around."""
    dof, pitch, surface, laws, tables = (
        q.dof[0],
        q.pitch[0],
        surface_of(lay.link, link),
        lay.law_par,
        lay.law_table,
    )
    for c in range(q.h_count[h]):
        u, n_felt = dof * c, 0
        first, second, d1, d2 = -1, -1, math.inf, math.inf
        s, a = q.theta[c, 0], q.theta[c, 1]
        for t in range(q.n_listed[0]):
            i = q.listed[t]
            d = distance(surface, s, a, lay.s[i], lay.a[i])
            if d < d1:
                first, d1, second, d2 = i, d, first, d1
            elif d < d2:
                second, d2 = i, d
            for x in range(q.n_felt_by[t]):
                if q.felt_by[t, x] == c:
                    n_felt += q.jacobian[t, u + 2] ** 2 > FELT * FELT * q.variance[t]
        if (n_felt >= ENOUGH and misfit(q, h) <= 1.0) or second < 0:
            continue
        x, y = s - lay.s[first], wrap(a - lay.a[first], surface.period)
        lx, ly = lay.s[second] - lay.s[first], wrap(lay.a[second] - lay.a[first], surface.period)
        law = lay.law[first]
        p = pressure(laws, tables, law, amplitude(laws, law, q.theta[c, 2])[0], d1)[0]
        along = (x * lx + y * ly) / (lx * lx + ly * ly)
        for turn in range(3 + (DIRECTIONS if around else 0)):
            if turn == 0:  # over the line through both
                ds, da = 2.0 * (along * lx - x), 2.0 * (along * ly - y)
            elif turn == 1:  # over the nearest
                ds, da = -2.0 * x, -2.0 * y
            elif turn == 2:  # twice as far from it
                ds, da = x, y
            else:
                angle = math.atan2(y, x) + 2.0 * math.pi * (turn - 2.5) / DIRECTIONS
                ds, da = AROUND * pitch * math.cos(angle), AROUND * pitch * math.sin(angle)
            if ds * ds + da * da > (SAME * pitch) ** 2:  # the nearest tactel reads the same
                far = distance(surface, s + ds, a + da, lay.s[first], lay.a[first])
                log_force = log_force_at(laws, tables, law, p, far)
                put(q, propose(q, c, -1, 1), 0, q.kind[c], s + ds, a + da, log_force, q.theta[c, 3])


@inner_kernel
def closest_to(lay: Layout, q: Search, link: int, k: int, c: int) -> tuple[int, float]:
    """Return the contact of ``theta`` that is closest to contact c, and its distance (m)."""
    surface, nearest, least = surface_of(lay.link, link), -1, math.inf
    for e in range(k):
        d = distance(surface, q.theta[c, 0], q.theta[c, 1], q.theta[e, 0], q.theta[e, 1])
        if e != c and d < least:
            nearest, least = e, d
    return nearest, least


@inner_kernel
def closest_pair(lay: Layout, q: Search, link: int, k: int) -> tuple[int, int]:
    """Return the two contacts of ``theta`` that are closest to each other."""
    u, v, least = 0, 1, math.inf
    for c in range(k):
        e, d = closest_to(lay, q, link, k, c)
        if d < least:
            u, v, least = min(c, e), max(c, e), d
    return u, v


@inner_kernel
def propose_fewer(lay: Layout, q: Search, link: int, h: int) -> None:
    """Propose to leave out each contact, the nearest taking over, and to merge the closest pair."""
    k, theta = q.h_count[h], q.theta
    for c in range(k):
        e, _ = closest_to(lay, q, link, k, c)
        u = q.dof[0] * c + 2
        if 2.0 * TRY * q.inverse[u, u] > 1.0:  # its force is not that certain: chi^2 grows by 1 / variance
            put(q, propose(q, c, e, 1), 0, q.kind[e], theta[e, 0], theta[e, 1], theta[e, 2], theta[e, 3])
    u, v = closest_pair(lay, q, link, k)
    f0, f1 = math.exp(theta[u, 2]), math.exp(theta[v, 2])
    part, strongest = f1 / (f0 + f1), u if f0 >= f1 else v
    s = theta[u, 0] + part * (theta[v, 0] - theta[u, 0])
    a = theta[u, 1] + part * wrap(theta[v, 1] - theta[u, 1], surface_of(lay.link, link).period)
    put(q, propose(q, u, v, 1), 0, q.kind[strongest], s, a, math.log(f0 + f1), theta[strongest, 3])


@inner_kernel
def propose_pair(lay: Layout, q: Search, link: int, h: int) -> None:
    """Propose to bring the closest pair nearer to each other, with more force, and further apart."""
    theta = q.theta
    u, v = closest_pair(lay, q, link, q.h_count[h])
    if closest_to(lay, q, link, q.h_count[h], u)[1] > BESIDE * q.pitch[0]:
        return
    s, a = theta[v, 0] - theta[u, 0], wrap(theta[v, 1] - theta[u, 1], surface_of(lay.link, link).period)
    for turn in range(2):
        part, more = (SQUEEZE, SQUEEZED) if turn == 0 else (-SQUEEZE, -SQUEEZED)
        row = propose(q, u, v, 2)
        put(
            q,
            row,
            0,
            q.kind[u],
            theta[u, 0] + part * s,
            theta[u, 1] + part * a,
            theta[u, 2] + more,
            theta[u, 3],
        )
        put(
            q,
            row,
            1,
            q.kind[v],
            theta[v, 0] - part * s,
            theta[v, 1] - part * a,
            theta[v, 2] + more,
            theta[v, 3],
        )


@inner_kernel
def propose_more(lay: Layout, q: Search, link: int, h: int) -> None:
    """Propose to add a contact at the two largest residuals, and to split each along the residual."""
    surface, pitch, theta, last = surface_of(lay.link, link), q.pitch[0], q.theta, -1
    for _ in range(2):
        best, z_best = -1, FELT
        for t in range(q.n_listed[0]):
            z = q.pull[t] * math.sqrt(q.weight[t])
            if z > z_best and t != last:
                best, z_best = t, z
        if best < 0:
            break
        i, last = q.listed[best], best
        kind = q.kind[0]
        put(
            q,
            propose(q, -1, -1, 1),
            0,
            kind,
            lay.s[i],
            lay.a[i],
            log_force_at(lay.law_par, lay.law_table, lay.law[i], q.pull[best], 0.0),
            q.kind_mean[kind],
        )
    for c in range(q.h_count[h]):
        s, a, xx, xy, yy, chi2 = theta[c, 0], theta[c, 1], 0.0, 0.0, 0.0, 0.0
        for t in range(q.n_listed[0]):
            i = q.listed[t]
            x, y = lay.s[i] - s, wrap(lay.a[i] - a, surface.period)
            if x * x + y * y < (BESIDE * pitch) ** 2 and q.weight[t] > 0.0:
                xx, xy, yy = xx + q.pull[t] * x * x, xy + q.pull[t] * x * y, yy + q.pull[t] * y * y
                chi2 += q.pull[t] ** 2 * q.weight[t] - 1.0
        if chi2 <= 0.0:  # noise alone explains what is left
            continue
        angle, half = 0.5 * math.atan2(2.0 * xy, xx - yy), theta[c, 2] - math.log(2.0)
        for part in SPLITS:
            x, y, row = part * pitch * math.cos(angle), part * pitch * math.sin(angle), propose(q, c, -1, 2)
            put(q, row, 0, q.kind[c], s + x, a + y, half, theta[c, 3])
            put(q, row, 1, q.kind[c], s - x, a - y, half, theta[c, 3])
