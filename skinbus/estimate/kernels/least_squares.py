"""Damped least squares of the contact law: the most likely places and forces of a given number of contacts.

::

    minimise  chi^2 = sum_j w_j (p_j - sum_k p_law(d_jk, F_k))^2      over (s_k, a_k, log F_k)

over the listed tactels, silent ones too: zero is information; and over the widths of contacts whose law was
not measured with what presses, see ``normal_equations``. A law that ends at its reach pulls at no tactel
beyond, so a touched tactel first has an owner, one contact whose law goes on below zero there; when the fit
has settled with a tactel still beyond its reach, it goes on without owners. Steps are those of Levenberg and
Marquardt, with a damping in proportion to the diagonal: units do not matter.

Assumption: errors of the readings are normal and independent. Failure: a local minimum; the start
decides, which is why clustering comes first. The iterations are bounded and the outcome is a status.
Source: J. Nocedal, S. Wright, Numerical Optimization (2006), 10.3; the law in ``kernels.law``.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.geometry import develop, surface_of, undevelop
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.normal_equations import (
    NARROWEST,
    evaluate,
    is_sized,
    n_unknowns,
    off_skin,
    widest,
)
from skinbus.estimate.kernels.workspace import Work
from skinbus.jit import inner_kernel

CONVERGED, ITERATION_LIMIT, NO_INFORMATION, OFF_SKIN = 0, 1, 2, 3
"""Status of a fit: at a minimum; stopped by the limit; some parameter has no effect; a place off the skin."""

MAX_ITERATIONS = 40
FIRST_DAMPING, LAST_DAMPING = 1e-4, 1e10
NEGLIGIBLE = 1e-7
"""Expected decrease of chi^2 at which a fit ends: a step of 3e-4 standard deviations."""
UNSEEN_PLACE, UNSEEN_LOG_FORCE = 1e-6, 1e-4
"""Such a step is taken without a look at what it does to chi^2, if it is also no larger than this (m, 1)."""
MAX_LOG_STEP = 1.0
"""A step changes a force by at most a factor e: beyond, the law is not the line the step believes in."""
HOPELESS = 1e20
"""Damping at which a unit diagonal outweighs every entry: a pivot that is still not positive is no number."""
SINGULAR = 1e-14
"""Part of the diagonal that a pivot must keep: what rounding leaves of a parameter that others stand for."""
INSIDE = 1.0 - 1e-9
"""Part of a board's half extent that is on it whatever rounding does."""
MAX_WIDTH_STEP = 0.3
"""Of log w; beyond, the field is not the line the step assumes."""
LOG_FORCE_MIN, LOG_FORCE_MAX = -46.0, 46.0
"""1e-20 N to 1e20 N: any skin is inside, and no power of it leaves the range of floats."""


@inner_kernel
def onto_board(lay: Layout, link: int, patch: int, place: Floats) -> None:
    """Bring a place (s, a) to the nearest one on the board of a patch, the seam around it included."""
    board, patch_s, patch_a = lay.board, lay.patch_s, lay.patch_a
    surface = surface_of(lay.link, link)
    cos, sin = board[patch, 0], board[patch, 1]
    x, y = develop(surface, place[0], place[1], patch_a[patch])
    x -= patch_s[patch]
    u, v = cos * x + sin * y, cos * y - sin * x
    half_u, half_v = INSIDE * board[patch, 2], INSIDE * board[patch, 3]
    u, v = min(max(u, -half_u), half_u), min(max(v, -half_v), half_v)
    x, y = patch_s[patch] + cos * u - sin * v, sin * u + cos * v
    place[0], place[1] = undevelop(surface, x, y, patch_a[patch])


@inner_kernel
def copy_rows(source: Floats, to: Floats, k: int) -> None:
    """Copy the first k contacts of one table to another."""
    for c in range(k):
        for x in range(4):
            to[c, x] = source[c, x]


@inner_kernel
def factorise(w: Work, normal: Floats, m: int, damping: float) -> bool:
    """Write L and 1/D of the damped normal matrix L D L' to ``factor`` and ``pivot``; False if it has none.

    Damping is relative to the diagonal, and so is what counts as a positive pivot: units do not matter. From
    a damping of ``HOPELESS`` on there is always a factor: what is not finite is left out of it.
    """
    factor, pivot = w.factor, w.pivot
    for u in range(m):
        known = normal[u, u] > 0.0
        x = normal[u, u] * (1.0 + damping) if known else 1.0
        for v in range(u):
            y = normal[u, v] if known else 0.0
            for t in range(v):
                y -= factor[u, t] * factor[t, v]
            factor[v, u] = y  # L D above the diagonal
            factor[u, v] = y * pivot[v]
            x -= y * factor[u, v]
        if x > SINGULAR * normal[u, u] or not known:
            pivot[u] = 1.0 / x
        elif damping < HOPELESS:
            return False
        else:
            for t in range(u):
                factor[u, t] = factor[t, u] = 0.0
            pivot[u] = 1.0 / (damping * normal[u, u])
    return True


@inner_kernel
def solve_step(w: Work, gradient: Floats, m: int) -> None:
    """Write the step that the factor gives for a gradient."""
    factor, pivot, step = w.factor, w.pivot, w.step
    for u in range(m):
        step[u] = gradient[u]
        for t in range(u):
            step[u] -= factor[u, t] * step[t]
    for u in range(m - 1, -1, -1):
        step[u] *= pivot[u]
        for t in range(u + 1, m):
            step[u] -= factor[t, u] * step[t]


@inner_kernel
def fit(
    lay: Layout, w: Work, link: int, k: int, n: int, max_move: float, max_iterations: int
) -> tuple[float, int, int]:
    """Fit k contacts in ``w.theta`` to the n tactels in ``w.list``; return chi^2, status, iterations.

    ``max_move`` (m) bounds one step on the surface. What :func:`evaluate` writes is that of the answer
    afterwards, or of the place a last, negligible step before it, without owners.
    """
    m = n_unknowns(lay, w, k)
    theta, trial, step = w.theta, w.trial, w.step
    normal, gradient = w.normal, w.gradient
    other_normal, other_gradient = w.normal_trial, w.gradient_trial
    chi2, extrapolated, off_by = math.inf, False, 0.0
    damping, gain = FIRST_DAMPING, math.inf
    status = ITERATION_LIMIT
    iterations = 0
    swapped, taken = False, True
    fresh = True  # the trial is the start: taken as it is
    copy_rows(theta, trial, k)
    while True:
        chi2_trial, extrapolated_trial, off_by_trial = evaluate(
            lay, w, link, trial, k, n, other_normal, other_gradient
        )
        taken = fresh or (chi2_trial <= chi2 and off_by_trial <= off_by)
        if taken:
            chi2, extrapolated, off_by = chi2_trial, extrapolated_trial, off_by_trial
            theta, trial = trial, theta
            normal, other_normal = other_normal, normal
            gradient, other_gradient = other_gradient, gradient
            swapped = not swapped
            damping = FIRST_DAMPING if fresh else max(0.1 * damping, 1e-10)
            fresh = False
        else:
            damping *= 10.0

        if gain < NEGLIGIBLE or damping > LAST_DAMPING:
            if not extrapolated:
                status = CONVERGED
                break
            # settled beyond an owner's reach: on without owners
            for t in range(n):
                w.owner[t] = -1
            copy_rows(theta, trial, k)
            fresh, gain = True, math.inf
            continue
        if iterations == max_iterations or is_over(w):
            break
        iterations += 1

        while not factorise(w, normal, m, damping):
            damping = max(10.0 * damping, 1e-8)
        solve_step(w, gradient, m)
        gain, largest = 0.0, 0.0
        for c in range(k):
            u = 3 * c
            gain += step[u] * gradient[u] + step[u + 1] * gradient[u + 1] + step[u + 2] * gradient[u + 2]
            move2 = step[u] * step[u] + step[u + 1] * step[u + 1]
            shrink = 1.0
            if move2 > max_move * max_move:
                shrink = max_move / math.sqrt(move2)
            if abs(step[u + 2]) * shrink > MAX_LOG_STEP:
                shrink = MAX_LOG_STEP / abs(step[u + 2])
            if m > 3 * k:
                u = 3 * k + c
                gain += step[u] * gradient[u]
                if abs(step[u]) * shrink > MAX_WIDTH_STEP:
                    shrink = MAX_WIDTH_STEP / abs(step[u])
                if not is_sized(lay, w, c):
                    wide = theta[c, 3] * math.exp(shrink * step[u])
                    trial[c, 3] = min(max(wide, NARROWEST), widest(k))
                largest = max(largest, (step[u] * (UNSEEN_PLACE / UNSEEN_LOG_FORCE)) ** 2)
                u = 3 * c
            trial[c, 0] = theta[c, 0] + shrink * step[u]
            trial[c, 1] = theta[c, 1] + shrink * step[u + 1]
            trial[c, 2] = min(max(theta[c, 2] + shrink * step[u + 2], LOG_FORCE_MIN), LOG_FORCE_MAX)
            largest = max(largest, move2, (step[u + 2] * (UNSEEN_PLACE / UNSEEN_LOG_FORCE)) ** 2)
        unseen = gain < NEGLIGIBLE and largest < UNSEEN_PLACE * UNSEEN_PLACE and not extrapolated
        if unseen and off_skin(lay, w, link, trial, k) <= off_by:
            copy_rows(trial, theta, k)
            status = CONVERGED
            break
    if swapped:
        copy_rows(theta, w.theta, k)
    if extrapolated or not taken:
        for t in range(n):
            w.owner[t] = -1
        evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
    elif swapped:
        for u in range(m):
            w.gradient[u] = gradient[u]
            for v in range(u + 1):
                w.normal[u, v] = normal[u, v]
    if off_by > 0.0:
        status = OFF_SKIN
    elif status == CONVERGED:
        for u in range(3 * k):
            if not w.normal[u, u] > 0.0:
                status = NO_INFORMATION
    return chi2, status, iterations
