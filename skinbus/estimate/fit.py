"""Damped least squares of the contact law: the most likely places and forces of a given number of contacts.

::

    minimise  chi^2 = sum_j w_j (p_j - sum_k p_law(d_jk, F_k))^2      over (s_k, a_k, log F_k)

over the listed tactels, silent ones included: zero is information. A saturated reading counts only
while the law predicts less than its limit. A law that ends at its reach pulls at no tactel beyond, so
a touched tactel first has an owner, one contact whose law goes on below zero there; when the fit has
settled with a tactel still beyond its owner's reach, it goes on without owners. Steps are those of
Levenberg and Marquardt on the normal matrix scaled to a unit diagonal: units do not matter.

Assumption: errors of the readings are normal and independent. Failure: a local minimum; the start
decides, which is why clustering comes first. The iterations are bounded and the outcome is a status.
Source: J. Nocedal, S. Wright, Numerical Optimization (2006), 10.3; the law in ``lawkernel``.
"""

from __future__ import annotations

import math

from numba import njit

from skinbus.estimate.geometry import separation
from skinbus.estimate.lawkernel import amplitude, pressure, pressure_beyond, reach
from skinbus.estimate.layout import Floats, Layout
from skinbus.estimate.workspace import SATURATED, Work

CONVERGED, ITERATION_LIMIT, NO_INFORMATION = 0, 1, 2
"""Status of a fit: ended at a minimum; stopped by the limit; the tactels say nothing of some parameter."""

MAX_ITERATIONS = 40
NEGLIGIBLE = 1e-7
"""Expected decrease of chi^2 at which a fit ends: a step of 3e-4 standard deviations."""
MAX_LOG_STEP = 1.0
"""A step changes a force by at most a factor e: beyond, the law is not the line the step believes in."""
LOG_FORCE_MIN, LOG_FORCE_MAX = -46.0, 46.0
"""1e-20 N to 1e20 N: any skin is inside, and no power of it leaves the range of floats."""


@njit(cache=True, nogil=True)
def evaluate(
    lay: Layout, w: Work, link: int, theta: Floats, k: int, n: int, normal: Floats, gradient: Floats
) -> tuple[float, bool]:
    """Return chi^2 of k contacts ``theta`` on the n listed tactels; write J'WJ and J'Wr.

    Also returns whether any tactel is out of its owner's reach.
    """
    radius, taper, period, length = lay.link[link, 0], lay.link[link, 1], lay.link[link, 2], lay.link[link, 3]
    par, table, tactel_law, tactel_s, tactel_a = lay.law_par, lay.law_table, lay.law, lay.s, lay.a
    amp, damp, far, row, involved = w.amp, w.damp, w.far, w.row, w.involved
    measured, state, listed, weights, owner = w.p, w.state, w.list, w.weight, w.owner
    background = w.background
    for c in range(k):
        for law in range(len(par)):
            amp[c, law], damp[c, law] = amplitude(par[law], theta[c, 2])
            far[c, law] = reach(par[law], amp[c, law])
    for u in range(3 * k):
        gradient[u] = 0.0
        for v in range(u + 1):
            normal[u, v] = 0.0
    chi2 = 0.0
    stretched = False
    for t in range(n):
        i = listed[t]
        law = tactel_law[i]
        predicted = background[t]
        n_involved = 0
        for c in range(k):
            d, d_s, d_a = separation(
                radius, taper, period, length, theta[c, 0], theta[c, 1], tactel_s[i], tactel_a[i]
            )
            if d < far[c, law]:
                p, p_d, p_amp = pressure(par[law], table[law], amp[c, law], d)
            elif owner[t] == c:
                stretched = True
                p, p_d, p_amp = pressure_beyond(par[law], table[law], amp[c, law], d)
            else:
                continue
            predicted += p
            u = 3 * n_involved
            row[u], row[u + 1], row[u + 2] = p_d * d_s, p_d * d_a, p_amp * damp[c, law]
            involved[n_involved] = c
            n_involved += 1
        residual = measured[i] - predicted
        if state[i] == SATURATED and residual <= 0.0:
            continue
        weight = weights[t]
        chi2 += weight * residual * residual
        for e in range(n_involved):
            for x in range(3):
                left = weight * row[3 * e + x]
                u = 3 * involved[e] + x
                gradient[u] += left * residual
                for f in range(e):
                    v = 3 * involved[f]
                    normal[u, v] += left * row[3 * f]
                    normal[u, v + 1] += left * row[3 * f + 1]
                    normal[u, v + 2] += left * row[3 * f + 2]
                v = 3 * involved[e]
                for y in range(x + 1):
                    normal[u, v + y] += left * row[3 * e + y]
    return chi2, stretched


@njit(cache=True, nogil=True)
def factorise(w: Work, normal: Floats, m: int, damping: float) -> bool:
    """Write the Cholesky factor of the scaled, damped normal matrix; return False if there is none."""
    scale, factor = w.scale, w.factor
    for u in range(m):
        scale[u] = 1.0 / math.sqrt(normal[u, u]) if normal[u, u] > 0.0 else 0.0
    for u in range(m):
        for v in range(u + 1):
            x = normal[u, v] * scale[u] * scale[v]
            if u == v:
                x = 1.0 + damping
            for t in range(v):
                x -= factor[u, t] * factor[v, t]
            if u > v:
                factor[u, v] = x / factor[v, v]
            elif x > 1e-14:
                factor[u, u] = math.sqrt(x)
            else:
                return False
    return True


@njit(cache=True, nogil=True)
def solve_step(w: Work, gradient: Floats, m: int) -> None:
    """Write the step that the factor gives for a gradient, in parameters' own units."""
    scale, factor, step = w.scale, w.factor, w.step
    for u in range(m):
        x = gradient[u] * scale[u]
        for t in range(u):
            x -= factor[u, t] * step[t]
        step[u] = x / factor[u, u]
    for u in range(m - 1, -1, -1):
        x = step[u]
        for t in range(u + 1, m):
            x -= factor[t, u] * step[t]
        step[u] = x / factor[u, u]
    for u in range(m):
        step[u] *= scale[u]


@njit(cache=True, nogil=True)
def fit(
    lay: Layout, w: Work, link: int, k: int, n: int, max_move: float, max_iterations: int
) -> tuple[float, int, int]:
    """Fit k contacts in ``w.theta`` to the n tactels in ``w.list``; return chi^2, status, iterations.

    ``w.normal`` holds J'WJ at the result. ``max_move`` (m) bounds one step on the surface.
    """
    m = 3 * k
    theta, trial, step = w.theta, w.trial, w.step
    normal, gradient = w.normal, w.gradient
    other_normal, other_gradient = w.normal_trial, w.gradient_trial
    chi2, stretched = evaluate(lay, w, link, theta, k, n, normal, gradient)
    damping = 1e-4
    status = ITERATION_LIMIT
    iterations = 0
    swapped = False
    while iterations < max_iterations:
        iterations += 1
        if not factorise(w, normal, m, damping):
            damping = max(10.0 * damping, 1e-8)
            continue
        solve_step(w, gradient, m)
        gain = 0.0
        for c in range(k):
            u = 3 * c
            gain += step[u] * gradient[u] + step[u + 1] * gradient[u + 1] + step[u + 2] * gradient[u + 2]
            move = math.sqrt(step[u] * step[u] + step[u + 1] * step[u + 1])
            shrink = 1.0
            if move > max_move:
                shrink = max_move / move
            if abs(step[u + 2]) * shrink > MAX_LOG_STEP:
                shrink = MAX_LOG_STEP / abs(step[u + 2])
            trial[c, 0] = theta[c, 0] + shrink * step[u]
            trial[c, 1] = theta[c, 1] + shrink * step[u + 1]
            trial[c, 2] = min(max(theta[c, 2] + shrink * step[u + 2], LOG_FORCE_MIN), LOG_FORCE_MAX)
        chi2_trial, stretched_trial = evaluate(lay, w, link, trial, k, n, other_normal, other_gradient)
        if chi2_trial <= chi2:
            chi2, stretched = chi2_trial, stretched_trial
            theta, trial = trial, theta
            normal, other_normal = other_normal, normal
            gradient, other_gradient = other_gradient, gradient
            swapped = not swapped
            damping = max(0.1 * damping, 1e-10)
        else:
            damping *= 10.0
        if gain < NEGLIGIBLE or damping > 1e10:
            if not stretched:
                status = CONVERGED
                break
            for t in range(n):
                w.owner[t] = -1
            chi2, stretched = evaluate(lay, w, link, theta, k, n, normal, gradient)
            damping = 1e-4
    if swapped:
        for c in range(k):
            for x in range(3):
                w.theta[c, x] = theta[c, x]
        for u in range(m):
            for v in range(u + 1):
                w.normal[u, v] = normal[u, v]
    if status == CONVERGED:
        for u in range(m):
            if not w.normal[u, u] > 0.0:
                status = NO_INFORMATION
    return chi2, status, iterations
