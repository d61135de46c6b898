"""Whether what presses is what a law was learned with, and what is in an answer while that is not refuted.

A law that was learned from presses is that of their indenter. The evidence of contacts as this law has them
is compared with that of contacts of other sizes, whose modes are put on the learned law (``disc_shapes``).
Where the law fits, and other sizes are unlikely by one linear step, nothing more is asked. Else contacts stay
as learned until the readings refute it, with the second moments of all answers about them: amid the tactels
of a coarse array a tip and a finger may read alike. A contact that became wide is first fitted again with
the width of its law: it may have become so in a wrong place. Errors of learned laws have the tails of
``sized_contacts``; a normal law of errors refutes one contact in seventy of an array whose zeros have moved.

Failure: an indenter that reads like that of the calibration within the noise, which three fifths of the prior
are for, is further off than its standard deviation says.
Source: R. Kass, A. Raftery, Bayes factors (1995), doi:10.1080/01621459.1995.10476572, 4.1 (Laplace's method).
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.constants import BAD_FIT
from skinbus.estimate.kernels.covariance import add_prior
from skinbus.estimate.kernels.disc_shapes import ANY_SIZE, SIZES, SPREADS
from skinbus.estimate.kernels.geometry import distance, surface_of
from skinbus.estimate.kernels.law import (
    OWN_SIZE,
    PROFILED,
    SHAPED,
    amplitude,
    peak_pressure,
    profile,
    shape_change,
)
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import LOG_FORCE_MAX, LOG_FORCE_MIN, evaluate, factorise
from skinbus.estimate.kernels.sized_contacts import TAIL, evaluate_sized, weigh_force, width_of
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.contact_shape import open_side
from skinbus.estimate.levels.contact_width import WORTH_WIDTH, expected
from skinbus.estimate.levels.posterior import BARELY_OUTSIDE
from skinbus.estimate.levels.sized_answers import (
    log_weights,
    moments_about,
    solve_sizes,
    squares,
    weigh_sized,
)
from skinbus.estimate.levels.split_merge import clear_owners, copy_rows
from skinbus.jit import inner_kernel, runtime_int

AS_LEARNED, OF_FINGERS = 0.6, 0.5
"""Prior probability that what presses is what the law was learned with, and that for a law of fingertips,
which is a part of the prior of sizes: tips and thumbs have the other half. What has the part r and reads like
what was learned is 1 / (3 r) variances off: tips by 1.3, and by 2.5 with 0.6 and a third for fingertips."""
REFUTED_LAW = 0.05
"""Posterior probability of that below which it is refuted. At 0.2 tips under the law of a tip are 0.54 mm and
5 % of their force off in place of 0.42 and 2; at 0.01 thumbs under that of a finger 0.49 mm, not 0.45."""
FAINT = 0.25
"""Part of the peak of a law that the nearest tactel reads: where all read less, amid them, what a law misfits
is as large as what other sizes change. On coarse arrays sizes found there were wrong, and places by 5 mm."""
WRONG = 0.005
"""What modes about a learned law are wrong by for each unit of u from its own size, as a part of the root of
peak times reading: tips and thumbs by 0.3 % of it."""
SAME_PLACE = 1e-3
"""m: answers for one prior of sizes nearer than this are one."""
UNLIKELY = 0.03
"""Odds of another size below which nothing of it is in an answer."""


@inner_kernel
def has_learned(lay: Layout, w: Work, n: int) -> bool:
    """Return whether one of the listed tactels has a law that was learned from presses."""
    found = False
    for t in range(n):
        law = lay.law[w.list[t]]
        found |= lay.law_par[law, PROFILED] * lay.law_par[law, SHAPED] != 0.0
    return found


@inner_kernel
def own_size(lay: Layout, w: Work, c: int) -> float:
    """Return the size that the law under contact c of ``theta``, as evaluated last, is of."""
    home = w.nearest_tactel[c]
    return float(lay.law_par[lay.law[home], OWN_SIZE]) if home >= 0 else 0.0


@inner_kernel
def own_part(own: float) -> int:
    """Return the part of the prior of sizes that the size ``own`` of a law is of."""
    part, nearest = runtime_int(0), math.inf
    for j in range(len(SIZES)):
        off = abs(own - SIZES[j]) / SPREADS[j]
        if off < nearest:
            part, nearest = runtime_int(j), off
    return part


@inner_kernel
def is_faint(lay: Layout, w: Work, link: int, k: int, n: int) -> bool:
    """Return whether one of the contacts in ``theta``, evaluated last, is amid tactels and near to none."""
    theta, laws, surface, faint = w.theta, lay.law_par, surface_of(lay.link, link), False
    for c in range(k):
        home = w.nearest_tactel[c]
        if home < 0:
            continue
        law = lay.law[home]
        d = distance(surface, theta[c, 0], theta[c, 1], lay.s[home], lay.a[home]) * lay.narrow[home]
        peak, _ = profile(laws, lay.law_table, law, 0.0)
        near, _ = profile(laws, lay.law_table, law, d)
        if laws[law, PROFILED] * laws[law, SHAPED] == 0.0 or near > FAINT * peak:
            continue
        out_s, out_a = open_side(lay, w, link, theta[c, 0], theta[c, 1], n, BARELY_OUTSIDE)
        faint |= out_s == 0.0 and out_a == 0.0
    return faint


@inner_kernel
def sizes_explain(lay: Layout, w: Work, link: int, k: int, n: int) -> bool:
    """Return whether the k contacts of ``best``, of other sizes than learned, leave no more than expected.

    Then none is missing. The listed tactels get the weights of that.
    """
    if not has_learned(lay, w, n):
        return False
    copy_rows(w.best, w.theta, k)
    weigh_sized(lay, w, k, n, wrong_by(ANY_SIZE))
    take_own_sizes(lay, w, link, k, n)
    solve_sizes(lay, w, link, k, n, runtime_int(0), 0.0, ANY_SIZE, 1.0)
    if w.rate[0] == -math.inf:
        return False
    evaluate_sized(lay, w, link, w.theta, k, n, 0.0, ANY_SIZE, w.normal, w.gradient)
    chi2 = squares(w, n)
    for c in range(k):
        chi2 += (w.theta[c, 3] / ANY_SIZE) ** 2
    return bool(chi2 <= expected(k, n))


@inner_kernel
def take_own_sizes(lay: Layout, w: Work, link: int, k: int, n: int) -> float:
    """Put the sizes of the laws under the contacts of ``theta`` in place of widths; return chi^2 before."""
    clear_owners(w, n)
    chi2, _, _ = evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
    for c in range(k):
        w.theta[c, 3] = own_size(lay, w, c)
    return chi2


@inner_kernel
def rate_linear(lay: Layout, w: Work, link: int, k: int, n: int) -> tuple[float, float]:
    """Return the logs of the evidence of the contacts in ``theta``, which have the sizes of their laws.

    The first is that of these sizes, the second of any; each by one step from where they are, which is near
    where sizes are determined and the law is true.
    """
    chi2, _ = evaluate_sized(lay, w, link, w.theta, k, n, 0.0, ANY_SIZE, w.normal, w.gradient)
    add_prior(w, k)
    of_sizes, weights = 0.0, log_weights(lay, w, n)
    for c in range(k):
        of_sizes += (w.theta[c, 3] / ANY_SIZE) ** 2
    gain, log_volume = settle_linear(w, 4 * k)
    other = log_volume - 0.5 * (chi2 - gain) - k * math.log(ANY_SIZE) + weights
    gain, log_volume = settle_linear(w, 3 * k)
    return log_volume - 0.5 * (chi2 - of_sizes - gain) + weights, other


@inner_kernel
def rate_wide(lay: Layout, w: Work, link: int, k: int, n: int) -> float:
    """Return the log of the evidence of the contacts in ``theta``, of which some are wider than their law."""
    clear_owners(w, n)
    evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
    chi2 = 0.0
    for t in range(n):
        square = w.pull[t] * (w.p[w.list[t]] - w.predicted[t])
        is_profiled = lay.law_par[lay.law[w.list[t]], PROFILED] != 0.0
        chi2 += TAIL * math.log(1.0 + square / TAIL) if is_profiled else square
    for c in range(k):
        chi2 += weigh_force(lay, w, w.theta, c, w.normal, w.gradient)
        chi2 += WORTH_WIDTH if w.theta[c, 3] != 1.0 else 0.0
    add_prior(w, k)
    _, log_volume = settle_linear(w, 3 * k)
    return log_volume - 0.5 * chi2 + log_weights(lay, w, n)


@inner_kernel
def settle_linear(w: Work, m: int) -> tuple[float, float]:
    """Return what chi^2 has to fall yet by the normal equations of m unknowns, and log det^-1/2 of them."""
    damping = 0.0
    while not factorise(w, w.normal, m, damping):
        damping = max(10.0 * damping, 1e-13)
    gain, log_volume, y = 0.0, 0.0, w.step
    for u in range(m):
        y[u] = w.gradient[u]
        for t in range(u):
            y[u] -= w.factor[u, t] * y[t]
        gain += y[u] * y[u] * w.pivot[u]
        log_volume += 0.5 * math.log(w.pivot[u])
    return gain, log_volume


@inner_kernel
def wrong_by(off: float) -> float:
    """Return what modes about a learned law are wrong by at a size ``off`` its own, see ``WRONG``."""
    return WRONG * off


@inner_kernel
def start_at_top(lay: Layout, w: Work, n: int, size: float) -> bool:
    """Put the contact in ``theta`` to the listed tactel that reads most; return whether there is one."""
    top, most = -1, 0.0
    for t in range(n):
        left = w.p[w.list[t]] - w.background[t]
        if left > most:
            top, most = t, left
    if top < 0:
        return False
    i, theta = w.list[top], w.theta
    law = lay.law[i]
    peak = peak_pressure(lay.law_par, lay.law_table, law, 0.0)
    change, _, _ = shape_change(lay.law_par, lay.law_table, law, 0.0, size)
    amp, power = amplitude(lay.law_par, law, 0.0)
    peak = max(peak + amp * change, 0.1 * peak)
    theta[0, 0], theta[0, 1], theta[0, 3] = lay.s[i], lay.a[i], size
    theta[0, 2] = min(max(math.log(most / peak) * amp / power, LOG_FORCE_MIN), LOG_FORCE_MAX)
    return True


@inner_kernel
def is_same(w: Work, j: int, o: int) -> bool:
    """Return whether answers j and o of the one contact are one mode."""
    one, other = w.sized[j, 0], w.sized[o, 0]
    off = (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2
    return bool(off < SAME_PLACE * SAME_PLACE or w.rate[o] == -math.inf)


@inner_kernel
def keep_learned(lay: Layout, w: Work, k: int, j: int, rate: float) -> None:
    """Keep the contacts of ``members`` as they are, posterior means where they have such, as answer j.

    ``rate`` is the log of their evidence.
    """
    share = OF_FINGERS if own_part(w.before[0, 3]) == 0 else AS_LEARNED
    w.rate[j] = rate + math.log(share / (1.0 - share))
    for c in range(k):
        to = w.members[c]
        at, cov = w.sized[j, c], w.sized_moment[j, c]
        at[0], at[1], at[2], at[3] = w.s[to], w.a[to], w.log_force[to], w.before[c, 3]
        for x in range(4):
            for y in range(4):
                cov[x, y] = w.covariance[to, x, y] if x < 3 and y < 3 else 0.0
        if w.averaged[to]:
            for x in range(3):
                at[x] = w.mean[to, x]
                for y in range(3):
                    cov[x, y] = w.mean_covariance[to, x, y]


@inner_kernel
def doubt_sizes(lay: Layout, w: Work, link: int, k: int, n_answers: int, last: int) -> None:
    """Write the second moments of all answers about answer ``last``, as learned, which the contacts keep.

    Where the readings refute it, the contacts are flagged.
    """
    moment = w.normal_trial
    period = surface_of(lay.link, link).period
    for c in range(k):
        to = w.members[c]
        if w.rate[last] < REFUTED_LAW:
            w.quality[to] |= BAD_FIT
        moments_about(w, c, w.sized[last, c], n_answers, period)
        for x in range(3):
            for y in range(3):
                if w.averaged[to]:
                    w.mean_covariance[to, x, y] = moment[x, y]
                else:
                    w.covariance[to, x, y] = moment[x, y]
        _, by_size = width_of(lay, lay.patch_start[w.patch[to]], w.sized[last, c, 3])
        w.width_sd[to] = abs(by_size) * math.sqrt(moment[3, 3])
