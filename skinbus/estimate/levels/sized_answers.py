"""Answers of contacts of free size: solved under a normal prior of their sizes, and what they are together.

Place, log force and size of the contacts of a group are solved by damped Gauss-Newton steps from a start. The
log of the evidence of an answer is that of its normal approximation, by which answers for several priors are
weighed; what they are together has the first and second moments of their mixture.

Source: D. Titterington, A. Smith, U. Makov, Statistical Analysis of Finite Mixture Distributions (1985), 2;
A. Gelman et al., Bayesian Data Analysis (2013), 4.1 (normal approximation).
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.covariance import add_prior, invert
from skinbus.estimate.kernels.disc_shapes import GAINS
from skinbus.estimate.kernels.geometry import wrap
from skinbus.estimate.kernels.groups import UNREAD
from skinbus.estimate.kernels.law import MISFIT, PROFILED, SHAPED, peak_pressure
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.least_squares import (
    LOG_FORCE_MAX,
    LOG_FORCE_MIN,
    MAX_LOG_STEP,
    factorise,
    solve_step,
)
from skinbus.estimate.kernels.sized_contacts import evaluate_sized
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.estimate.levels.split_merge import copy_rows
from skinbus.jit import inner_kernel

SMALLEST, LARGEST = -0.9, 1.3
"""u that are tried: tips of no size are -0.7, discs of 28 mm 1.1."""
SHAPE = 0.0045
"""Part of its peak by which a contact's law and its modes are wrong anywhere, as a rule."""
FAINT = 1e-200
"""A product of ratios is taken to its logarithm from here on."""
FLANK = 0.02
"""The same at a flank, which is all that is read of a contact whose peak is at full scale."""
STEPS = 10
FIRST_DAMPING, DAMPED = 1e-4, 1e-2
"""Damping at first, and at least after a step that has not lowered chi^2: with less it would be the same."""
SETTLED = 0.01
"""chi^2 that a step must promise to be tried: a tenth of a standard deviation."""
MOST_PLACE, MOST_SIZE = 5e-3, 0.5
"""m, 1: no step is longer."""


@inner_kernel
def weigh_sized(lay: Layout, w: Work, k: int, n: int, learned: float) -> None:
    """Give tactels whose law has modes the weights of contacts of free size.

    ``learned`` is what modes about a learned law are wrong by, as a part of the geometric mean of peak and
    reading; 0 before sizes are solved for, when ``theta`` has widths.
    """
    laws, most, peaks, shape = lay.law_par, 0.0, 0.0, SHAPE
    for t in range(n):
        most = max(most, w.p[w.list[t]])
        if w.state[w.list[t]] == SATURATED:
            shape = FLANK
    for c in range(k):
        peak = 0.0
        for law in range(len(laws)):
            if laws[law, SHAPED] != 0.0:
                peak = max(peak, peak_pressure(laws, lay.law_table, law, w.theta[c, 2]))
        wide = w.theta[c, 3] if learned == 0.0 else 1.0
        peak = min(peak / (wide * wide), UNREAD * most)
        peaks += peak * peak
    for t in range(n):
        i = w.list[t]
        law = lay.law[i]
        if laws[law, SHAPED] != 0.0:
            wrong = GAINS * laws[law, MISFIT] * w.p[i]
            if laws[law, PROFILED] != 0.0:
                shaped = learned * learned * math.sqrt(peaks) * max(w.p[i], 0.0)
            else:
                shaped = shape * shape * peaks
            w.weight[t] = 1.0 / (lay.sigma[i] * lay.sigma[i] + wrong * wrong + w.doubt[t] + shaped)


@inner_kernel
def log_weights(lay: Layout, w: Work, n: int) -> float:
    """Return half the sum of the logarithms of the weights times the noise, by which answers are compared."""
    log, product = 0.0, 1.0
    for t in range(n):
        product *= w.weight[t] * lay.sigma[w.list[t]] * lay.sigma[w.list[t]]
        if product < FAINT:
            log, product = log + 0.5 * math.log(product), 1.0
    return log + 0.5 * math.log(product)


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
        w.rate[j] = log_volume - 0.5 * chi2 + math.log(share) - k * math.log(spread) + log_weights(lay, w, n)
    return chi2, is_last


@inner_kernel
def squares(w: Work, n: int) -> float:
    """Return the sum of the squares of what the listed tactels, as evaluated last, are off by."""
    left = 0.0
    for t in range(n):
        residual = w.p[w.list[t]] - w.predicted[t]
        left += w.weight[t] * residual * residual if w.counts[t] > 0.0 else 0.0
    return left


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
def moments_about(w: Work, c: int, at: Floats, n_answers: int, period: float) -> None:
    """Write to ``normal_trial`` the second moments of all answers of contact c about ``at``.

    They are of s, a, force, size; ``at`` has the logarithm of the force.
    """
    sized, off, moment = w.sized, w.step, w.normal_trial
    for x in range(4):
        for y in range(4):
            moment[x, y] = 0.0
    for j in range(n_answers):
        share = w.rate[j]
        if share == 0.0:  # one off the skin has no numbers
            continue
        off[0] = sized[j, c, 0] - at[0]
        off[1] = wrap(sized[j, c, 1] - at[1], period)
        off[2] = math.exp(sized[j, c, 2]) - math.exp(at[2])
        off[3] = sized[j, c, 3] - at[3]
        for x in range(4):
            for y in range(4):
                moment[x, y] += share * (w.sized_moment[j, c, x, y] + off[x] * off[y])


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
