"""The answer of a group: its contacts with covariances and flags, from the hypotheses that were kept.

The number of contacts is that of the best hypothesis. Of each contact, place and force are the mean over the
hypotheses with that number whose kind of size is the simplest that holds ``REFUTED`` of the probability (tips
and thumbs are one); the covariance is the second moment of all with that number about it, so other sizes and
other modes are part of it. Where chi^2 per degree of freedom is above 1, the law explains less than its
variances say, and noise is what it was: the covariance grows with the excess, by the part of the variance
that is not noise.

Source of the last: R. Birge, The calculation of errors by the method of least squares (1932).
"""

from __future__ import annotations

import math

from skinbus.arrays import Floats
from skinbus.estimate.budget import is_over
from skinbus.estimate.contacts import Quality
from skinbus.estimate.kernels.board_places import keep_on_board
from skinbus.estimate.kernels.disc_shapes import TIP
from skinbus.estimate.kernels.geometry import surface_of, wrap
from skinbus.estimate.kernels.law import amplitude, log_force_at
from skinbus.estimate.kernels.layout import PEAK, Layout
from skinbus.estimate.kernels.workspace import SATURATED, Search, Work
from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.estimate.search.evidence import RIVAL, best_of, freedom, misfit, nearest_contact, settle
from skinbus.estimate.search.least_squares import CONVERGED
from skinbus.estimate.search.model import feels
from skinbus.jit import inner_kernel

REFUTED = 0.2
"""Share of the probability below which a kind of size is refuted: the mean over sizes is wrong where a
calibration holds, its size alone where it does not."""
LEAST = 3
"""Tactels that a place and a force need."""
FEW = 0.25
"""Pitches: standard deviation of a place from which on it is flagged."""


@inner_kernel
def matching(lay: Layout, q: Search, link: int, h: int, best: int, c: int) -> int:
    """Return the contact of hypothesis h that is nearest to contact c of the best one."""
    s, a = q.h_theta[best, c, 0], q.h_theta[best, c, 1]
    return max(nearest_contact(lay, link, q.h_theta[h], q.h_count[h], s, a, -1)[0], 0)


@inner_kernel
def share_of(q: Search, h: int, best: int) -> float:
    """Return how probable hypothesis h is beside the best; 0 with another number of contacts or far below."""
    behind = q.h_score[best] - q.h_score[h]
    return math.exp(-behind) if q.h_count[h] == q.h_count[best] and behind <= RIVAL else 0.0


@inner_kernel
def write_mean(lay: Layout, q: Search, link: int, best: int, c: int, place: Floats) -> None:
    """Write the mean place, log force and size of contact c of the best hypothesis over its simplest kind.

    That is the first kind of size that is not refuted; tips and thumbs are one.
    """
    period, theta, wanted, total = surface_of(lay.link, link).period, q.h_theta, 0, 0.0
    for x in range(4):
        place[x] = q.row[x] = 0.0
    for h in range(q.n_hypotheses[0]):
        share = share_of(q, h, best)
        q.row[min(q.h_kind[h, matching(lay, q, link, h, best, c)], TIP)] += share
        total += share
    while wanted < TIP and q.row[wanted] < REFUTED * total:
        wanted += 1
    for h in range(q.n_hypotheses[0]):
        e = matching(lay, q, link, h, best, c)
        share = share_of(q, h, best) if min(q.h_kind[h, e], TIP) == wanted else 0.0
        for x in range(4):
            off = theta[h, e, x] - theta[best, c, x]
            place[x] += share * (wrap(off, period) if x == 1 else off)
    for x in range(4):
        place[x] = theta[best, c, x] + place[x] / q.row[wanted]
    place[1] = wrap(place[1], period)
    keep_on_board(lay, link, q.listed, q.n_listed[0], place)


@inner_kernel
def write_moments(
    lay: Layout, q: Search, link: int, best: int, c: int, place: Floats, moment: Floats
) -> None:
    """Write the covariance of contact c of the best hypothesis: the moment of all rivals about a place."""
    period, total = surface_of(lay.link, link).period, 0.0
    excess = max(q.h_chi2[best, 0] / freedom(q, best) - 1.0, 0.0)
    scale = max(1.0 + q.h_chi2[best, 2] * excess, misfit(q, best))
    for x in range(3):
        for y in range(3):
            moment[x, y] = 0.0
    for h in range(q.n_hypotheses[0]):
        share, e = share_of(q, h, best), matching(lay, q, link, h, best, c)
        total += share
        force = math.exp(q.h_theta[h, e, 2])
        q.step[0] = q.h_theta[h, e, 0] - place[0]
        q.step[1] = wrap(q.h_theta[h, e, 1] - place[1], period)
        q.step[2] = force - math.exp(place[2])
        for x in range(3):
            for y in range(x + 1):
                own = q.h_covariance[h, e, x, y] * (force if x == 2 else 1.0) * (force if y == 2 else 1.0)
                moment[x, y] += share * (own + q.step[x] * q.step[y])
    for x in range(3):
        for y in range(x + 1):
            moment[x, y] *= scale / total
            moment[y, x] = moment[x, y]


@inner_kernel
def flag_contact(
    lay: Layout, w: Work, q: Search, link: int, best: int, c: int, to: int, is_cut: bool
) -> None:
    """Write quality, status and tactels of contact c of the best hypothesis, as prepared last."""
    flags, n_felt, is_full, strongest, home = 0, 0, False, -1.0, q.listed[0]
    for t in range(q.n_listed[0]):
        i = q.listed[t]
        if feels(q, t, c):
            n_felt += 1
            is_full |= w.state[i] == SATURATED
            if w.p[i] > strongest:
                home, strongest = i, w.p[i]
    moment, few, law = w.covariance[to], FEW * q.pitch[0], lay.law[q.listed[0]]
    half, diff = 0.5 * (moment[0, 0] + moment[1, 1]), 0.5 * (moment[0, 0] - moment[1, 1])
    if n_felt < LEAST or half + math.sqrt(diff * diff + moment[1, 0] * moment[1, 0]) > few * few:
        flags |= Quality.FEW_TACTELS.value
        # a deviation further away, the same reading takes a larger force than a linear covariance says
        peak = amplitude(lay.law_par, law, w.place[to, 2])[0] * lay.law_par[law, PEAK]
        away = math.sqrt(max(moment[0, 0], moment[1, 1]))
        far = math.exp(log_force_at(lay.law_par, lay.law_table, law, peak, away))
        moment[2, 2] += (far - math.exp(w.place[to, 2])) ** 2
    if is_full:
        flags |= Quality.SATURATED.value
    if misfit(q, best) > 1.0 or q.tailed[0]:
        flags |= Quality.MISFIT.value
    if q.h_status[best] != CONVERGED:
        flags |= Quality.NOT_CONVERGED.value
    if is_cut:
        flags |= Quality.OVER_BUDGET.value
    w.quality[to], w.status[to], w.n_tactels[to] = flags, q.h_status[best], n_felt
    w.patch[to], w.link[to] = lay.patch[home], link
    w.residual[to] = math.sqrt(q.h_chi2[best, 0] / max(q.h_chi2[best, 1], 1.0))


@inner_kernel
def write_answer(lay: Layout, w: Work, q: Search, link: int, first: int, full: bool) -> None:
    """Write the contacts of the best hypothesis to the rows of group ``first``, and to new rows if more."""
    best, row, k = best_of(q), 0, 0
    settle(lay, w, q, link, best)
    is_cut = is_over(w)
    if is_cut:  # no budget is left to evaluate rivals
        q.h_score[best] += RIVAL
    for c in range(q.h_count[best]):
        while row < w.n_contacts[0] and not (w.alive[row] and w.group[row] == first):
            row += 1
        if row == len(w.alive):  # no room: those found first are the strongest
            break
        w.n_contacts[0] = max(w.n_contacts[0], row + 1)
        w.alive[row], w.again[row], w.level[row], w.group[row] = True, False, 2 if full else 1, first
        write_mean(lay, q, link, best, c, w.place[row])
        write_moments(lay, q, link, best, c, w.place[row], w.covariance[row])
        q.rows[c] = row
        row, k = row + 1, k + 1
    for other in range(row, w.n_contacts[0]):
        w.alive[other] = w.alive[other] and w.group[other] != first
    gain = 0.0
    for t in range(q.n_listed[0]):
        i = q.listed[t]
        left = 0.0 if w.state[i] == SATURATED else q.pull[t]
        gain += ((w.p[i] - q.back[t]) ** 2 - left**2) / lay.sigma[i] ** 2
    for c in range(k):
        flag_contact(lay, w, q, link, best, c, q.rows[c], is_cut)
        # what explains the readings is a contact unless noise reads as much
        w.alive[q.rows[c]] = gain >= EVIDENCE or misfit(q, best) > 1.0 or is_cut
