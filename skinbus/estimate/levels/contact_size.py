"""The size of what presses: estimated with place and force where the law was not measured with what presses.

A law that ships with a board is that of fingertips. A tip or a thumb presses another field (``disc_shapes``),
and place and force by that law are off by many of their standard deviations. So once contacts are found, each
group is solved again for s, a, log force and size u of its contacts, by damped Gauss-Newton steps from the
answer for fingertips. What is left of the misfit of the law is that of gains and of the modes.

Where the tactels do not determine a size, amid four of a coarse array, place and force follow it on a curve.
Its prior is then a mixture: of fingertips, tips and thumbs for a lone contact, of fingertips and any size for
those with a core in common. Each part gives an answer that is nearly linear in the size. The contact is that
of fingertips unless the readings refute it, else the mean of all parts, and its covariance has the second
moments of all parts about it, and what an indenter that is not round would change (``contact_shape``).

Assumption: what presses acts like a uniform disc of 2 to 25 mm. Failure: two tips close together may be one
wide contact; contacts on fewer than three tactels stay as they are.
Source: D. Titterington, A. Smith, U. Makov, Statistical Analysis of Finite Mixture Distributions (1985), 2;
A. Gelman et al., Bayesian Data Analysis (2013), 4.1 (normal approximation).
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.constants import BAD_FIT, FEW_TACTELS, OVER_BUDGET
from skinbus.estimate.kernels.covariance import add_prior, invert
from skinbus.estimate.kernels.disc_shapes import ANY_SIZE, FINGERS, GAINS, SHARES, SIZES, SPREADS
from skinbus.estimate.kernels.geometry import surface_of, wrap
from skinbus.estimate.kernels.groups import (
    PLACE_SLACK,
    UNREAD,
    add_background,
    group_contacts,
    list_tactels,
    load_group,
    rank_groups,
    reach_of,
)
from skinbus.estimate.kernels.law import (
    MISFIT,
    UNSIZED,
    peak_pressure,
)
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import (
    LOG_FORCE_MAX,
    LOG_FORCE_MIN,
    MAX_LOG_STEP,
    OFF_SKIN,
    factorise,
    solve_step,
)
from skinbus.estimate.kernels.sized_contacts import evaluate_sized, width_of
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.estimate.levels.contact_shape import allow_for_shape
from skinbus.estimate.levels.contact_width import expected
from skinbus.estimate.levels.fit import MISFIT_LIMIT
from skinbus.estimate.levels.posterior import BROAD
from skinbus.estimate.levels.split_merge import copy_rows
from skinbus.jit import inner_kernel, runtime_int

REFUTED = 0.05
"""Posterior share below which what presses is no fingertip: then, and for small discs, the answer is the mean
of all parts. At 0.5 the force of a finger of 12 mm on seams is 23 % off in place of 14."""
SMALLEST, LARGEST = -0.9, 1.3
"""u that are tried: tips of no size are -0.7, discs of 28 mm 1.1."""
KNOWN = 0.1
"""Standard deviation of u below which place and force are linear in it."""
TIPS = -0.25
"""u of a disc of 9 mm: fields of smaller ones differ less and less, so that there is another mode."""
ENOUGH = 6
"""Tactels that a contact reaches from which on there is one mode: two more than it has unknowns."""
SHAPE = 0.005
"""Part of its peak by which a contact's law and its modes are wrong anywhere, as a rule."""
FLANK = 0.02
"""The same at a flank, which is all that is read of a contact whose peak is at full scale."""
STEPS = 10
FIRST_DAMPING, DAMPED = 1e-4, 1e-2
"""Damping at first, and at least after a step that has not lowered chi^2: with less it would be the same."""
SETTLED = 0.01
"""chi^2 that a step must promise to be tried: a tenth of a standard deviation."""
MOST_PLACE, MOST_SIZE = 5e-3, 0.5
"""m, 1: no step is longer."""
MIXED = 16.0
"""Variance of a place, relative to that with its size, from which on an answer has other modes and stays."""


@inner_kernel
def size_contacts(lay: Layout, w: Work) -> None:
    """Estimate the sizes of contacts that have a law which was not measured with what presses."""
    is_unsized = False
    for law in range(len(lay.law_par)):
        is_unsized |= lay.law_par[law, UNSIZED] != 0.0
    for c in range(w.n_contacts[0]):
        w.width_sd[c] = 0.0
    if not is_unsized or w.n_contacts[0] == 0:
        return
    if is_over(w):
        for c in range(w.n_contacts[0]):
            w.quality[c] |= OVER_BUDGET
        return
    group_contacts(lay, w, 0.0, 0.0)
    for o in range(rank_groups(w)):
        size_group(lay, w, w.turn[o])


@inner_kernel
def size_group(lay: Layout, w: Work, first: int) -> None:
    """Estimate sizes, places and forces of a group; write them with their covariance."""
    theta, members, link = w.theta, w.members, w.link[first]
    k = load_group(w, first)
    if is_over(w):
        for c in range(k):
            w.quality[members[c]] |= OVER_BUDGET
        return
    for c in range(k):
        to = members[c]
        if w.level[to] == 0 or w.quality[to] & (FEW_TACTELS | OVER_BUDGET) or w.status[to] == OFF_SKIN:
            return
    n = list_tactels(lay, w, link, k, 0.0, PLACE_SLACK, 0.0)
    if n == 0:
        return
    add_background(lay, w, link, first, k, n)
    weigh_sized(lay, w, k, n)
    for c in range(k):
        theta[c, 3] = 0.0
    copy_rows(theta, w.before, k)
    n_answers = runtime_int(2)
    chi2, is_last = solve_sizes(lay, w, link, k, n, runtime_int(1), 0.0, ANY_SIZE, 1.0 - FINGERS)
    w.rate[0] = -math.inf
    known, small = w.rate[1] > -math.inf and chi2 <= expected(k, n), False
    for c in range(k):
        known &= w.inverse[3 * k + c, 3 * k + c] <= KNOWN * KNOWN and w.n_tactels[members[c]] >= ENOUGH
        small |= theta[c, 3] < TIPS
    if k > 1 and (small or not known):
        copy_rows(w.before, theta, k)
        solve_sizes(lay, w, link, k, n, runtime_int(0), 0.0, SPREADS[0], FINGERS)
    elif small or not known:
        n_answers = runtime_int(len(SIZES))
        for j in range(len(SIZES)):
            copy_rows(w.before, theta, k)
            theta[0, 3] = SIZES[j]
            solve_sizes(lay, w, link, k, n, j, SIZES[j], SPREADS[j], SHARES[j])
    best = 1
    for j in range(n_answers):
        best = j if w.rate[j] > w.rate[best] else best
    if is_over(w):
        for c in range(k):
            w.quality[members[c]] |= OVER_BUDGET
        return
    if w.rate[best] == -math.inf:
        return
    top, total = w.rate[best], 0.0
    for j in range(n_answers):
        total += math.exp(w.rate[j] - top)
    for j in range(n_answers):
        w.rate[j] = math.exp(w.rate[j] - top) / total
    likely = not known and w.rate[0] >= REFUTED
    if small or not (known and is_last):
        copy_rows(w.sized[0 if likely else best], theta, k)
        for c in range(0 if likely else k):
            average_answers(w, c, n_answers, surface_of(lay.link, link).period)
        evaluate_sized(lay, w, link, theta, k, n, 0.0, ANY_SIZE, w.normal, w.gradient)
    write_answer(lay, w, link, k, n, n_answers, known)


@inner_kernel
def weigh_sized(lay: Layout, w: Work, k: int, n: int) -> None:
    """Give tactels whose law was not measured with what presses the weights of contacts of free size."""
    laws, most, peaks, shape = lay.law_par, 0.0, 0.0, SHAPE
    for t in range(n):
        most = max(most, w.p[w.list[t]])
        if w.state[w.list[t]] == SATURATED:
            shape = FLANK
    for c in range(k):
        peak = 0.0
        for law in range(len(laws)):
            if laws[law, UNSIZED] != 0.0:
                peak = max(peak, peak_pressure(laws, lay.law_table, law, w.theta[c, 2]))
        peak = min(peak / (w.theta[c, 3] * w.theta[c, 3]), UNREAD * most)
        peaks += peak * peak
    for t in range(n):
        i = w.list[t]
        if laws[lay.law[i], UNSIZED] != 0.0:
            wrong = GAINS * laws[lay.law[i], MISFIT] * w.p[i]
            w.weight[t] = 1.0 / (lay.sigma[i] * lay.sigma[i] + wrong * wrong + shape * shape * peaks)


@inner_kernel
def solve_sizes(
    lay: Layout, w: Work, link: int, k: int, n: int, j: int, size: float, spread: float, share: float
) -> tuple[float, bool]:
    """Solve for the k contacts in ``theta``, sizes under a normal prior; keep answer j.

    Returns its chi^2, and whether it is what was evaluated last. The log of its evidence, -inf for one off
    the skin, is in ``rate``. ``share`` is that of its prior.
    """
    theta, trial, step, gradient = w.theta, w.trial, w.step, w.gradient
    chi2, off_by = evaluate_sized(lay, w, link, theta, k, n, size, spread, w.normal, gradient)
    damping, is_last = FIRST_DAMPING, True
    for _ in range(STEPS):
        if is_over(w):
            break
        while not factorise(w, w.normal, 4 * k, damping):
            damping = max(10.0 * damping, 1e-8)
        solve_step(w, gradient, 4 * k)
        gain = 0.0
        for c in range(k):
            u, row = 3 * c, 3 * k + c
            gain += step[u] * gradient[u] + step[u + 1] * gradient[u + 1] + step[u + 2] * gradient[u + 2]
            gain += step[row] * gradient[row]
            place = math.sqrt(step[u] * step[u] + step[u + 1] * step[u + 1])
            shrink = min(
                1.0,
                MOST_PLACE / max(place, 1e-300),
                MAX_LOG_STEP / max(abs(step[u + 2]), 1e-300),
                MOST_SIZE / max(abs(step[row]), 1e-300),
            )
            trial[c, 0], trial[c, 1] = theta[c, 0] + shrink * step[u], theta[c, 1] + shrink * step[u + 1]
            trial[c, 2] = min(max(theta[c, 2] + shrink * step[u + 2], LOG_FORCE_MIN), LOG_FORCE_MAX)
            trial[c, 3] = min(max(theta[c, 3] + shrink * step[row], SMALLEST), LARGEST)
        if gain < SETTLED:
            break
        chi2_trial, off_trial = evaluate_sized(
            lay, w, link, trial, k, n, size, spread, w.normal_trial, w.gradient_trial
        )
        is_last = chi2_trial <= chi2
        if is_last:
            chi2, off_by = chi2_trial, off_trial
            damping *= 0.1
            copy_rows(trial, theta, k)
            for u in range(4 * k):
                gradient[u] = w.gradient_trial[u]
                for v in range(u + 1):
                    w.normal[u, v] = w.normal_trial[u, v]
        else:
            damping = max(10.0 * damping, DAMPED)
    w.rate[j] = -math.inf
    if off_by <= 0.0:
        add_prior(w, k)
        invert(w, 4 * k)
        keep_answer(w, k, j)
        log_volume = 0.0
        for u in range(4 * k):
            log_volume += 0.5 * math.log(w.pivot[u])
        w.rate[j] = log_volume - 0.5 * chi2 + math.log(share) - k * math.log(spread)
    return chi2, is_last


@inner_kernel
def keep_answer(w: Work, k: int, j: int) -> None:
    """Keep the contacts in ``theta`` and their covariance, of s, a, force and size, as answer j."""
    theta, inverse = w.theta, w.inverse
    for c in range(k):
        force = math.exp(theta[c, 2])
        for x in range(4):
            w.sized[j, c, x] = theta[c, x]
            u = 3 * c + x if x < 3 else 3 * k + c
            for y in range(4):
                v = 3 * c + y if y < 3 else 3 * k + c
                scale = (force if x == 2 else 1.0) * (force if y == 2 else 1.0)
                w.sized_moment[j, c, x, y] = inverse[u, v] * scale


@inner_kernel
def write_answer(lay: Layout, w: Work, link: int, k: int, n: int, n_answers: int, known: bool) -> None:
    """Write the contacts in ``theta``, as evaluated last, and the second moments of all answers about them.

    Where sizes are not known, so is the posterior mean of a contact at a rim: a broad one stays.
    """
    theta, sized, off, moment = w.theta, w.sized, w.step, w.normal_trial
    period = surface_of(lay.link, link).period
    for c in range(k):
        to, chi2 = w.members[c], 0.0
        for x in range(4):
            for y in range(4):
                moment[x, y] = 0.0
        for j in range(n_answers):
            share = w.rate[j]
            if share == 0.0:  # one off the skin has no numbers
                continue
            off[0] = sized[j, c, 0] - theta[c, 0]
            off[1] = wrap(sized[j, c, 1] - theta[c, 1], period)
            off[2] = math.exp(sized[j, c, 2]) - math.exp(theta[c, 2])
            off[3] = sized[j, c, 3] - theta[c, 3]
            for x in range(4):
                for y in range(4):
                    moment[x, y] += share * (w.sized_moment[j, c, x, y] + off[x] * off[y])
        if w.averaged[to] and not known:
            cov = w.mean_covariance[to]
            if cov[0, 0] + cov[1, 1] > BROAD * BROAD:
                continue
            off[0], off[1] = w.mean[to, 0] - theta[c, 0], wrap(w.mean[to, 1] - theta[c, 1], period)
            off[2] = math.exp(w.mean[to, 2]) - math.exp(theta[c, 2])
            for x in range(3):
                for y in range(3):
                    moment[x, y] += off[x] * off[y]
        before = w.covariance[to, 0, 0] + w.covariance[to, 1, 1]
        if before > MIXED * w.wider_by[to] * (moment[0, 0] + moment[1, 1]):
            continue
        w.averaged[to] = False
        for m in range(w.n_felt[c]):
            t = w.felt_at[c, m]
            residual = w.p[w.list[t]] - w.predicted[t]
            chi2 += w.counts[t] * residual * residual
        wide, _ = width_of(lay, w.nearest_tactel[c], theta[c, 3])
        share = allow_for_shape(lay, w, link, c, n, theta[c], wide)
        for x in range(4):
            for y in range(4):
                moment[x, y] += share * (off[x] * off[y])
        w.s[to], w.a[to], w.log_force[to] = theta[c, 0], wrap(theta[c, 1], period), theta[c, 2]
        w.width[to], by_size = width_of(lay, w.nearest_tactel[c], theta[c, 3])
        w.width_sd[to] = abs(by_size) * math.sqrt(moment[3, 3])
        describe_sized(lay, w, to, chi2, w.n_felt[c])


@inner_kernel
def average_answers(w: Work, c: int, n_answers: int, period: float) -> None:
    """Bring contact c of ``theta``, one of the answers, to the mean of all, of shares ``rate``."""
    theta, sized, off = w.theta, w.sized, w.step
    force = math.exp(theta[c, 2])
    for x in range(4):
        off[x] = 0.0
    for j in range(n_answers):
        share = w.rate[j]
        if share == 0.0:  # one off the skin has no numbers
            continue
        off[0] += share * (sized[j, c, 0] - theta[c, 0])
        off[1] += share * wrap(sized[j, c, 1] - theta[c, 1], period)
        off[2] += share * (math.exp(sized[j, c, 2]) - force)
        off[3] += share * (sized[j, c, 3] - theta[c, 3])
    theta[c, 0], theta[c, 1], theta[c, 3] = theta[c, 0] + off[0], theta[c, 1] + off[1], theta[c, 3] + off[3]
    theta[c, 2] = math.log(force + off[2])


@inner_kernel
def describe_sized(lay: Layout, w: Work, to: int, chi2: float, n: int) -> None:
    """Write covariance, residual, reach and quality of a contact by the chi^2 of its n tactels."""
    w.contact_reach[to] = reach_of(lay, w.log_force[to], w.width[to])
    w.residual[to] = math.sqrt(chi2 / max(n, 1))
    most = n + MISFIT_LIMIT * math.sqrt(2.0 * n)
    wrong = max(chi2 / most, 1.0) if n > 0 else 1.0
    w.quality[to] &= ~BAD_FIT
    if wrong > 1.0:
        w.quality[to] |= BAD_FIT
    for x in range(3):
        for y in range(3):
            w.covariance[to, x, y] = wrong * w.normal_trial[x, y]
