"""The answer of a group: its contacts with covariances and flags, from the hypotheses that were kept.

* The number of contacts is that of the best hypothesis. Hypotheses with this number and near its score are
  averaged by their probability.
* Place, force and size of a contact are the mean over the hypotheses in which it has the simplest kind of
  size that is not refuted: one with ``REFUTED`` of the probability. Tips and thumbs are one kind here.
* The covariance is the second moment of all of them about this mean. So it includes other kinds of size and
  other modes.
* Where chi^2 is larger than its degrees of freedom n, the law explains less than its variances say. If a
  share r of the variances is not noise, the covariance grows by 1 + r (chi^2 / n - 1), for r = 1 the Birge
  ratio; for a misfit, at least by :func:`misfit`.

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
"""Share of the probability below which a kind of size is refuted. The mean over all kinds would be wrong
where the calibration holds, the kind as calibrated alone where it does not."""
LEAST_TACTELS = 3
"""Tactels that a place and a force need."""
UNSURE = 0.25
"""Standard deviation of a place, in pitches, from which on it is flagged."""


@inner_kernel
def matching(lay: Layout, q: Search, link: int, h: int, best: int, c: int) -> int:
    """Return the contact of hypothesis h that is nearest to contact c of the best one."""
    s, a = q.h_theta[best, c, 0], q.h_theta[best, c, 1]
    return max(nearest_contact(lay, link, q.h_theta[h], q.h_count[h], s, a, -1)[0], 0)


@inner_kernel
def share_of(q: Search, h: int, best: int) -> float:
    """Return the probability of hypothesis h in units of the best's; 0 with another number of contacts."""
    behind = q.h_score[best] - q.h_score[h]
    return math.exp(-behind) if q.h_count[h] == q.h_count[best] and behind <= RIVAL else 0.0


@inner_kernel
def write_mean(lay: Layout, q: Search, link: int, best: int, c: int, place: Floats) -> int:
    """Write the mean place, log force and size of contact c of the best hypothesis; return its patch.

    It is over the hypotheses in which the contact has the first kind of size that is not refuted, ``wanted``.
    """
    period, theta, shares = surface_of(lay.link, link).period, q.h_theta, q.scratch
    wanted, total = 0, 0.0
    for x in range(4):
        place[x] = shares[x] = 0.0
    for h in range(q.n_hypotheses[0]):
        share = share_of(q, h, best)
        shares[min(q.h_kind[h, matching(lay, q, link, h, best, c)], TIP)] += share
        total += share
    while wanted < TIP and shares[wanted] < REFUTED * total:
        wanted += 1
    for h in range(q.n_hypotheses[0]):
        e = matching(lay, q, link, h, best, c)
        share = share_of(q, h, best) if min(q.h_kind[h, e], TIP) == wanted else 0.0
        for x in range(4):
            off = theta[h, e, x] - theta[best, c, x]
            place[x] += share * (wrap(off, period) if x == 1 else off)
    for x in range(4):
        place[x] = theta[best, c, x] + place[x] / shares[wanted]
    place[1] = wrap(place[1], period)
    return keep_on_board(lay, link, q.listed, q.n_listed[0], place)


@inner_kernel
def write_moments(
    lay: Layout, q: Search, link: int, best: int, c: int, place: Floats, moment: Floats
) -> None:
    """Write the covariance of contact c of the best hypothesis: the moment of all rivals about ``place``."""
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
    """Write quality, status and tactels of contact c of the best hypothesis, as fitted last."""
    flags, n_felt, is_full = 0, 0, False
    for t in range(q.n_listed[0]):
        if feels(q, t, c):
            n_felt += 1
            is_full |= w.state[q.listed[t]] == SATURATED
    moment, few, law = w.covariance[to], UNSURE * q.pitch[0], lay.law[q.listed[0]]
    half, diff = 0.5 * (moment[0, 0] + moment[1, 1]), 0.5 * (moment[0, 0] - moment[1, 1])
    if n_felt < LEAST_TACTELS or half + math.sqrt(diff * diff + moment[1, 0] * moment[1, 0]) > few * few:
        flags |= Quality.FEW_TACTELS.value
        # if the place is off by its deviation, the same reading takes more force than to first order
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
    w.link[to] = link
    w.residual[to] = math.sqrt(q.h_chi2[best, 0] / max(q.h_chi2[best, 1], 1.0))


@inner_kernel
def write_answer(lay: Layout, w: Work, q: Search, link: int, first: int, full: bool) -> None:
    """Write the contacts of the best hypothesis to the rows of group ``first``, and to new rows if more."""
    best, row, k = best_of(q), 0, 0
    settle(lay, w, q, link, best)
    is_cut = is_over(w)
    for c in range(q.h_count[best]):
        while row < w.n_contacts[0] and not (w.alive[row] and w.group[row] == first):
            row += 1
        if row == len(w.alive):  # no room: those found first are the strongest
            break
        w.n_contacts[0] = max(w.n_contacts[0], row + 1)
        w.alive[row], w.again[row], w.level[row], w.group[row] = True, False, 2 if full else 1, first
        w.patch[row] = write_mean(lay, q, link, best, c, w.place[row])
        write_moments(lay, q, link, best, c, w.place[row], w.covariance[row])
        q.rows[c] = row
        row, k = row + 1, k + 1
    for other in range(row, w.n_contacts[0]):
        w.alive[other] = w.alive[other] and w.group[other] != first
    gain = 0.0
    for t in range(q.n_listed[0]):
        i = q.listed[t]
        left = 0.0 if w.state[i] == SATURATED else q.residual[t]
        gain += ((w.p[i] - q.outside[t]) ** 2 - left**2) / lay.sigma[i] ** 2
    for c in range(k):
        flag_contact(lay, w, q, link, best, c, q.rows[c], is_cut)
        # contacts that explain the readings are dropped where noise alone explains them, too
        w.alive[q.rows[c]] = gain >= EVIDENCE or misfit(q, best) > 1.0 or is_cut
