"""The answer of a group: its contacts with covariances and flags, from the hypotheses that were kept.

The number of contacts is that of the best hypothesis. Of each contact, place and force are the mean over the
hypotheses with that number whose kind of size is the simplest that holds ``REFUTED`` of the probability; the
covariance is the second moment of all of them about it, so other sizes and other modes are part of it.
"""

from __future__ import annotations

import math
from typing import Final

from skinbus.estimate.kernels.constants import BAD_FIT, FEW_TACTELS, FULL_SCALE, NOT_CONVERGED, OVER_BUDGET
from skinbus.estimate.kernels.geometry import distance, surface_of, wrap
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.workspace import KINDS, SATURATED, Search, Work
from skinbus.estimate.search.evidence import RIVAL, TIP, best_of, misfit, prepare
from skinbus.estimate.search.least_squares import CONVERGED, invert
from skinbus.jit import inner_kernel

REFUTED: Final = 0.2
"""Share of the probability below which a kind of size is refuted: the mean over sizes is wrong where a
calibration holds, its size alone where it does not."""
FEW: Final = 0.25
"""Pitches: standard deviation of a place from which on it is flagged."""


@inner_kernel
def matching(lay: Layout, q: Search, link: int, h: int, s: float, a: float) -> int:
    """Return the contact of hypothesis h that is nearest to a place."""
    surface, best, least = surface_of(lay.link, link), 0, math.inf
    for c in range(q.h_count[h]):
        d = distance(surface, s, a, q.h_theta[h, c, 0], q.h_theta[h, c, 1])
        if d < least:
            best, least = c, d
    return best


@inner_kernel
def simplest_kind(lay: Layout, q: Search, link: int, best: int, c: int) -> int:
    """Return the simplest kind of size of contact c of the best hypothesis that is not refuted."""
    top, k = q.h_score[best], q.h_count[best]
    s, a = q.h_theta[best, c, 0], q.h_theta[best, c, 1]
    for kind in range(KINDS):
        q.row[kind] = 0.0
    total = 0.0
    for h in range(q.n_hypotheses[0]):
        if q.h_count[h] == k and q.h_score[h] >= top - RIVAL:
            share = math.exp(q.h_score[h] - top)
            q.row[q.h_kind[h, matching(lay, q, link, h, s, a)]] += share
            total += share
    for kind in range(TIP):
        if q.row[kind] >= REFUTED * total:
            return kind
    return TIP


@inner_kernel
def write_contact(lay: Layout, w: Work, q: Search, link: int, best: int, c: int, to: int) -> None:
    """Write contact c of the best hypothesis to row ``to`` of the contacts."""
    surface, top, k, dof = surface_of(lay.link, link), q.h_score[best], q.h_count[best], q.dof[0]
    s0, a0 = q.h_theta[best, c, 0], q.h_theta[best, c, 1]
    wanted = simplest_kind(lay, q, link, best, c)
    total = s = a = log_force = size = 0.0
    for h in range(q.n_hypotheses[0]):
        if q.h_count[h] != k or q.h_score[h] < top - RIVAL:
            continue
        e = matching(lay, q, link, h, s0, a0)
        kind = q.h_kind[h, e]
        if kind != wanted and not (wanted == TIP and kind > TIP):
            continue
        share = math.exp(q.h_score[h] - top)
        total += share
        s += share * (q.h_theta[h, e, 0] - s0)
        a += share * wrap(q.h_theta[h, e, 1] - a0, surface.period)
        log_force += share * q.h_theta[h, e, 2]
        size += share * q.h_theta[h, e, 3]
    s, a, force, size = s / total, a / total, math.exp(log_force / total), size / total
    w.place[to, 0], w.place[to, 1] = s0 + s, wrap(a0 + a, surface.period)
    w.place[to, 2], w.place[to, 3] = log_force / total, size

    moment = w.covariance[to]
    for x in range(3):
        for y in range(3):
            moment[x, y] = 0.0
    total = 0.0
    for turn in range(q.n_hypotheses[0] + 1):
        h = turn if turn < best else best if turn == q.n_hypotheses[0] else turn  # the best is prepared last
        if (h == best) != (turn == q.n_hypotheses[0]) or q.h_count[h] != k or q.h_score[h] < top - RIVAL:
            continue
        prepare(lay, w, q, link, h)
        invert(q, dof * k)
        e = matching(lay, q, link, h, s0, a0)
        share, u, by_log = math.exp(q.h_score[h] - top), dof * e, math.exp(q.h_theta[h, e, 2])
        ds = q.h_theta[h, e, 0] - s0 - s
        da = wrap(q.h_theta[h, e, 1] - a0 - a, surface.period)
        df = by_log - force
        total += share
        moment[0, 0] += share * (q.inverse[u, u] + ds * ds)
        moment[1, 0] += share * (q.inverse[u + 1, u] + ds * da)
        moment[1, 1] += share * (q.inverse[u + 1, u + 1] + da * da)
        moment[2, 0] += share * (by_log * q.inverse[u + 2, u] + ds * df)
        moment[2, 1] += share * (by_log * q.inverse[u + 2, u + 1] + da * df)
        moment[2, 2] += share * (by_log * by_log * q.inverse[u + 2, u + 2] + df * df)
    wrong = max(misfit(q, best), 1.0)
    for x in range(3):
        for y in range(x + 1):
            moment[x, y] *= wrong / total
            moment[y, x] = moment[x, y]


@inner_kernel
def flag_contact(
    lay: Layout, w: Work, q: Search, link: int, best: int, c: int, to: int, is_cut: bool
) -> None:
    """Write quality, status and tactels of contact c of the best hypothesis, as prepared last."""
    flags, n_felt, is_full, strongest, home = 0, 0, False, -1.0, q.listed[0]
    for t in range(q.n_listed[0]):
        i = q.listed[t]
        for x in range(q.n_felt_by[t]):
            if q.felt_by[t, x] == c:
                n_felt += 1
                is_full |= w.state[i] == SATURATED
                if w.p[i] > strongest:
                    home, strongest = i, w.p[i]
    moment, few = w.covariance[to], FEW * q.pitch[0]
    half, diff = 0.5 * (moment[0, 0] + moment[1, 1]), 0.5 * (moment[0, 0] - moment[1, 1])
    if half + math.sqrt(diff * diff + moment[1, 0] * moment[1, 0]) > few * few:
        flags |= FEW_TACTELS
    if is_full:
        flags |= FULL_SCALE
    if misfit(q, best) > 1.0:
        flags |= BAD_FIT
    if q.h_status[best] != CONVERGED:
        flags |= NOT_CONVERGED
    if is_cut:
        flags |= OVER_BUDGET
    w.quality[to], w.status[to], w.n_tactels[to] = flags, q.h_status[best], n_felt
    w.patch[to], w.link[to] = lay.patch[home], link
    w.residual[to] = math.sqrt(q.h_chi2[best, 0] / max(q.h_chi2[best, 1], 1.0))


@inner_kernel
def write_answer(lay: Layout, w: Work, q: Search, link: int, first: int, full: bool, is_cut: bool) -> None:
    """Write the contacts of the best hypothesis to the rows of group ``first``, and to new rows if more."""
    best, row = best_of(q), 0
    for c in range(q.h_count[best]):
        while row < w.n_contacts[0] and not (w.alive[row] and w.group[row] == first):
            row += 1
        if row == w.n_contacts[0]:
            if row == len(w.alive):  # no room: those found first are the strongest
                return
            w.n_contacts[0] += 1
        w.alive[row], w.again[row], w.level[row], w.group[row] = True, False, 2 if full else 1, first
        write_contact(lay, w, q, link, best, c, row)
        flag_contact(lay, w, q, link, best, c, row, is_cut)
        row += 1
    while row < w.n_contacts[0]:
        if w.alive[row] and w.group[row] == first:
            w.alive[row] = False
        row += 1
