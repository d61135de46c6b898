"""Hypotheses: k contacts with a kind of size each, fitted, kept in a list and compared by their evidence.

Laplace's approximation of the log evidence, the *score* of a hypothesis::

    -1/2 objective - 1/2 log |N| + sum_k [log odds of a contact + log share of its kind
                                          - log (B^2 sd_f sd_u) - max(log F_k - f, 0)]

The objective and the normal matrix N are those of ``least_squares``, priors included: the place is uniform
over a board (standard deviation B = ``PLACE_SD``), log F_k ~ N(f, sd_f^2), u by its kind (``disc_shapes``).
Factors of 2 pi cancel. The last term is a factor 1 / F for forces above exp(f), the usual one. A learned law
has this factor in its f, too (``layout``); without the one or the other, light touches have larger errors.

All rivals have the variances of one hypothesis, so these need no normalisation. With variances of their own,
hypotheses of weak forces would gain log odds of 5 to 7.

Source: D. MacKay, Information Theory, Inference, and Learning Algorithms (2003), 27 and 28.
"""

from __future__ import annotations

import math

from skinbus.arrays import Floats
from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.disc_shapes import AS_MADE, FINGER, KINDS, MEANS
from skinbus.estimate.kernels.geometry import distance, surface_of
from skinbus.estimate.kernels.layout import FORCE_SD, LOG_FORCE, OWN_SIZE, SHAPED, SHARES, Layout
from skinbus.estimate.kernels.workspace import KEPT, SATURATED, Search, Work
from skinbus.estimate.search.least_squares import (
    ROUGH,
    SETTLED,
    copy_contacts,
    factorise,
    fit,
    invert,
    linearise,
    log_evidence,
    write_equations,
)
from skinbus.estimate.search.model import weigh
from skinbus.jit import inner_kernel

RIVAL = 7.0
"""Hypotheses within these log odds of the best are expanded, and count in the answer: a thousandth."""
GIVE_UP = 12.0
"""A fit or a move that is not expected to come within these log odds of the best is given up."""
ALIKE, ALIKE_FORCE = 0.05, 0.1
"""Pitches and log force within which two contacts are the same."""
SIGNIFICANT = 4.0
"""Standard deviations beyond chance. A hypothesis misfits if its chi^2 is further above its mean. A residual
beyond counts in chi^2 even where no contact reaches the tactel. Where chi^2 is below the square, another
contact costs more than it can gain."""


@inner_kernel
def set_priors(lay: Layout, q: Search, law: int) -> int:
    """Write the priors of contacts on boards of a law; return the kind of size to start with."""
    row = lay.law_par[law]
    q.dof[0] = 4 if row[SHAPED] != 0.0 else 3
    for kind in range(KINDS):
        q.kind_share[kind], q.kind_mean[kind] = row[SHARES + kind], MEANS[kind]
    q.kind_mean[AS_MADE] = row[OWN_SIZE]
    q.force_prior[0], q.force_prior[1] = row[LOG_FORCE], row[FORCE_SD]
    return FINGER if q.kind_share[FINGER] > q.kind_share[AS_MADE] else AS_MADE


@inner_kernel
def best_of(q: Search) -> int:
    """Return the hypothesis of the largest score."""
    best = 0
    for h in range(q.n_hypotheses[0]):
        best = h if q.h_score[h] > q.h_score[best] else best
    return best


@inner_kernel
def top_score(q: Search) -> float:
    """Return the score of the best hypothesis, minus infinity if there is none."""
    return float(q.h_score[best_of(q)]) if q.n_hypotheses[0] > 0 else -math.inf


@inner_kernel
def take_hypothesis(q: Search, h: int) -> int:
    """Copy the contacts of hypothesis h to ``theta``; return their number."""
    k = q.h_count[h]
    for c in range(k):
        q.kind[c] = q.h_kind[h, c]
    copy_contacts(q.h_theta[h], q.theta, k)
    return int(k)


@inner_kernel
def prepare(lay: Layout, w: Work, q: Search, link: int, h: int) -> float:
    """Take hypothesis h, evaluate it and factorise its matrix; return its score."""
    k = take_hypothesis(q, h)
    value = linearise(lay, w, q, link, k)
    return log_evidence(q, k, value) if factorise(q, q.dof[0] * k, 0.0) else -math.inf


@inner_kernel
def nearest_contact(
    lay: Layout, link: int, theta: Floats, k: int, s: float, a: float, but: int
) -> tuple[int, float]:
    """Return which of k contacts ``theta``, but for one, is nearest to a place, and its distance (m)."""
    surface, nearest, least = surface_of(lay.link, link), -1, math.inf
    for c in range(k):
        d = distance(surface, s, a, theta[c, 0], theta[c, 1])
        if c != but and d < least:
            nearest, least = c, d
    return nearest, least


@inner_kernel
def find_alike(lay: Layout, q: Search, link: int, k: int) -> int:
    """Return the kept hypothesis with the same k contacts as ``theta``, -1 if there is none."""
    surface, alike = surface_of(lay.link, link), ALIKE * q.pitch[0]
    for h in range(q.n_hypotheses[0]):
        if q.h_count[h] != k:
            continue
        same = True
        for c in range(k):
            near = False
            for e in range(k):
                if q.h_kind[h, e] == q.kind[c] and abs(q.theta[c, 2] - q.h_theta[h, e, 2]) < ALIKE_FORCE:
                    d = distance(
                        surface, q.theta[c, 0], q.theta[c, 1], q.h_theta[h, e, 0], q.h_theta[h, e, 1]
                    )
                    near |= d < alike
            same &= near
        if same:
            return h
    return -1


@inner_kernel
def consider(lay: Layout, w: Work, q: Search, link: int, k: int) -> None:
    """Fit the k contacts of ``theta``, and keep them as a hypothesis if their score is near the best."""
    if is_over(w):
        return
    bar = top_score(q) - GIVE_UP
    value, status = fit(lay, w, q, link, k, ROUGH, bar)
    if not (math.isfinite(value) and factorise(q, q.dof[0] * k, 0.0)):
        return
    score = log_evidence(q, k, value)
    to = find_alike(lay, q, link, k)
    if score < bar or (to >= 0 and q.h_score[to] >= score):
        return
    if to < 0:
        to = q.n_hypotheses[0]
        if to < KEPT:
            q.n_hypotheses[0] += 1
        else:  # in place of the one of the lowest score that is not expanded
            to = -1
            for h in range(KEPT):
                if not q.h_done[h] and (to < 0 or q.h_score[h] < q.h_score[to]):
                    to = h
            if to < 0 or q.h_score[to] > score:
                return
        q.h_done[to] = False
    q.h_count[to], q.h_status[to], q.h_score[to] = k, status, score
    for c in range(k):
        q.h_kind[to, c] = q.kind[c]
    copy_contacts(q.theta, q.h_theta[to], k)
    describe_hypothesis(lay, w, q, to)


@inner_kernel
def settle(lay: Layout, w: Work, q: Search, link: int, h: int) -> None:
    """Fit hypothesis h to the end, and describe it."""
    k = take_hypothesis(q, h)
    value, status = fit(lay, w, q, link, k, SETTLED, -math.inf)
    if not is_over(w):
        q.h_status[h] = status
    if math.isfinite(value) and factorise(q, q.dof[0] * k, 0.0):
        copy_contacts(q.theta, q.h_theta[h], k)
        describe_hypothesis(lay, w, q, h)


@inner_kernel
def describe_hypothesis(lay: Layout, w: Work, q: Search, h: int) -> None:
    """Write chi^2 of hypothesis h, as factorised last, and the covariances of its contacts.

    chi^2 is over the tactels that feel it or have a significant residual, without tails. A reading at full
    scale counts in it while the model predicts less, but such a bound determines nothing: the covariances are
    those without it.
    """
    chi2, n, left, dof, k, is_bound = 0.0, 0, 0.0, q.dof[0], q.h_count[h], False
    for t in range(q.n_listed[0]):
        if w.state[q.listed[t]] == SATURATED:
            if q.weight[t] == 0.0:
                continue
            q.weight[t], is_bound = 0.0, True
        square = q.residual[t] * q.residual[t] / q.variance[t]
        if q.n_felt_by[t] > 0 or square > SIGNIFICANT * SIGNIFICANT:
            chi2 += square
            n += 1
            left += 1.0 - lay.sigma[q.listed[t]] ** 2 / q.variance[t]
    q.h_chi2[h, 0], q.h_chi2[h, 1], q.h_chi2[h, 2] = chi2, n, left / max(n, 1)
    if is_bound:
        write_equations(lay, w, q, k)
        factorise(q, dof * k, 0.0)
    invert(q, dof * k)
    for c in range(k):
        for x in range(dof):
            for y in range(dof):
                q.h_covariance[h, c, x, y] = q.inverse[dof * c + x, dof * c + y]


@inner_kernel
def rescore(lay: Layout, w: Work, q: Search, link: int, h: int) -> None:
    """Set the variances by hypothesis h, and score all hypotheses anew."""
    weigh(lay, w, q, link, q.h_theta[h], q.h_count[h])
    for g in range(q.n_hypotheses[0]):
        q.h_score[g] = prepare(lay, w, q, link, g)
        describe_hypothesis(lay, w, q, g)


@inner_kernel
def freedom(q: Search, h: int) -> float:
    """Return the degrees of freedom of chi^2 of hypothesis h, at least 1."""
    return max(float(q.h_chi2[h, 1] - q.dof[0] * q.h_count[h]), 1.0)


@inner_kernel
def misfit(q: Search, h: int) -> float:
    """Return chi^2 of hypothesis h in units of its limit: above 1 it does not explain the readings."""
    n = freedom(q, h)
    return float(q.h_chi2[h, 0] / (n + SIGNIFICANT * math.sqrt(2.0 * n)))
