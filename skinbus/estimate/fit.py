"""Damped least squares of the contact law: the most likely places and forces of a given number of contacts.

::

    minimise  chi^2 = sum_j w_j (p_j - sum_k p_law(d_jk, F_k))^2      over (s_k, a_k, log F_k)

over the listed tactels, silent ones too: zero is information. A contact may be wider than the law, by a
factor w >= 1 that is held here: it makes p(d / w) / w^2, the same force on more skin. A saturated
reading counts only while the law predicts less than its limit. A law that ends at its reach pulls at no
tactel beyond, so a touched tactel first has an owner, one contact whose law goes on below zero there;
when the fit has settled with a tactel still beyond its reach, it goes on without owners. Steps are those of
Levenberg and Marquardt on the normal matrix scaled to a unit diagonal: units do not matter.

Assumption: errors of the readings are normal and independent. Failure: a local minimum; the start
decides, which is why clustering comes first. The iterations are bounded and the outcome is a status.
Source: J. Nocedal, S. Wright, Numerical Optimization (2006), 10.3; the law in ``lawkernel``.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import DONE, is_over
from skinbus.estimate.geometry import develop, separation, undevelop
from skinbus.estimate.kernel import part
from skinbus.estimate.lawkernel import amplitude, pressure, pressure_beyond, reach
from skinbus.estimate.layout import Floats, Layout
from skinbus.estimate.workspace import SATURATED, Work

CONVERGED, ITERATION_LIMIT, NO_INFORMATION, OFF_SKIN = 0, 1, 2, 3
"""Status of a fit: at a minimum; stopped by the limit; some parameter has no effect; a place off the skin."""

MAX_ITERATIONS = 40
FIRST_DAMPING, LAST_DAMPING = 1e-4, 1e10
NEGLIGIBLE = 1e-7
"""Expected decrease of chi^2 at which a fit ends: a step of 3e-4 standard deviations."""
MAX_LOG_STEP = 1.0
"""A step changes a force by at most a factor e: beyond, the law is not the line the step believes in."""
HOPELESS = 1e20
"""Damping at which a unit diagonal outweighs every entry: a pivot that is still not positive is no number."""
INSIDE = 1.0 - 1e-9
"""Part of a board's half extent that is on it whatever rounding does."""
LOG_FORCE_MIN, LOG_FORCE_MAX = -46.0, 46.0
"""1e-20 N to 1e20 N: any skin is inside, and no power of it leaves the range of floats."""


@part
def evaluate(
    lay: Layout, w: Work, link: int, theta: Floats, k: int, n: int, normal: Floats, gradient: Floats
) -> tuple[float, bool, float]:
    """Return chi^2 of k contacts ``theta`` on the n listed tactels; write J'WJ and J'Wr.

    Also returns whether any tactel is out of its owner's reach, and how far (m) a contact is off the skin.
    """
    radius, taper, period, length = lay.link[link, 0], lay.link[link, 1], lay.link[link, 2], lay.link[link, 3]
    laws, tables, tactel_law, tactel_s, tactel_a = lay.law_par, lay.law_table, lay.law, lay.s, lay.a
    amp, damp, far, rows, involved = w.amp, w.damp, w.far, w.rows, w.involved
    measured, state, listed, weights, owner = w.p, w.state, w.list, w.weight, w.owner
    background, fitted, nearest, home = w.background, w.predicted, w.nearest, w.home
    for c in range(k):
        for law in range(len(laws)):
            amp[c, law], damp[c, law] = amplitude(laws, law, theta[c, 2])
            far[c, law] = reach(laws, law, amp[c, law]) * theta[c, 3]
        nearest[c] = math.inf
        home[c] = -1
    for u in range(3 * k):
        gradient[u] = 0.0
        for v in range(3 * k):
            normal[u, v] = 0.0
    w.work[DONE] += n * k
    chi2 = 0.0
    stretched = False
    for t in range(n):
        i = listed[t]
        law = tactel_law[i]
        predicted = background[t]
        n_involved = 0
        for c in range(k):
            along = abs(theta[c, 0] - tactel_s[i])  # no distance is less
            if along > far[c, law] and along >= nearest[c] and owner[t] != c:
                continue
            d, d_s, d_a = separation(
                radius, taper, period, length, theta[c, 0], theta[c, 1], tactel_s[i], tactel_a[i]
            )
            if d < nearest[c]:
                nearest[c] = d
                home[c] = i
            if d <= far[c, law]:
                p, p_d, p_amp = pressure(laws, tables, law, amp[c, law], d / theta[c, 3])
            elif owner[t] == c:
                stretched = True
                p, p_d, p_amp = pressure_beyond(laws, law, amp[c, law], d / theta[c, 3], measured[i])
            else:
                continue
            narrow = 1.0 / theta[c, 3]
            spread = narrow * narrow
            p_d *= spread * narrow
            predicted += spread * p
            rows[n_involved, 0], rows[n_involved, 1] = p_d * d_s, p_d * d_a
            rows[n_involved, 2] = spread * p_amp * damp[c, law]
            involved[n_involved] = c
            n_involved += 1
        fitted[t] = predicted
        residual = measured[i] - predicted
        if state[i] == SATURATED and residual <= 0.0:
            continue
        weight = weights[t]
        weighted = weight * residual
        chi2 += weighted * residual
        for e in range(n_involved):
            u = 3 * involved[e]
            x, y, z = rows[e, 0], rows[e, 1], rows[e, 2]
            gradient[u] += x * weighted
            gradient[u + 1] += y * weighted
            gradient[u + 2] += z * weighted
            x, y, z = weight * x, weight * y, weight * z
            for f in range(e + 1):  # the block on the diagonal last; above it nothing is read
                v = 3 * involved[f]
                x2, y2, z2 = rows[f, 0], rows[f, 1], rows[f, 2]
                normal[u, v] += x * x2
                normal[u, v + 1] += x * y2
                normal[u, v + 2] += x * z2
                normal[u + 1, v] += y * x2
                normal[u + 1, v + 1] += y * y2
                normal[u + 1, v + 2] += y * z2
                normal[u + 2, v] += z * x2
                normal[u + 2, v + 1] += z * y2
                normal[u + 2, v + 2] += z * z2
    astray = 0.0
    for c in range(k):
        if home[c] < 0:
            astray = math.inf
            break
        away = off_board(lay.board, lay.patch_s, lay.patch_a, lay.link, link, lay.patch[home[c]], theta[c])
        astray = max(astray, away)
    return chi2, stretched, astray


@part
def off_board(
    board: Floats, patch_s: Floats, patch_a: Floats, links: Floats, link: int, patch: int, place: Floats
) -> float:
    """Return how far (m) a place (s, a) is off the board of a patch, the seam around it included; 0 on it."""
    x, y = develop(
        links[link, 0], links[link, 1], links[link, 2], links[link, 3], place[0], place[1], patch_a[patch]
    )
    x -= patch_s[patch]
    u = board[patch, 0] * x + board[patch, 1] * y
    v = board[patch, 0] * y - board[patch, 1] * x
    return float(max(abs(u) - board[patch, 2], abs(v) - board[patch, 3], 0.0))


@part
def onto_board(
    board: Floats, patch_s: Floats, patch_a: Floats, links: Floats, link: int, patch: int, place: Floats
) -> None:
    """Bring a place (s, a) to the nearest one on the board of a patch, the seam around it included."""
    radius, taper, period, length = links[link, 0], links[link, 1], links[link, 2], links[link, 3]
    cos, sin = board[patch, 0], board[patch, 1]
    x, y = develop(radius, taper, period, length, place[0], place[1], patch_a[patch])
    x -= patch_s[patch]
    u, v = cos * x + sin * y, cos * y - sin * x
    half_u, half_v = INSIDE * board[patch, 2], INSIDE * board[patch, 3]
    u, v = min(max(u, -half_u), half_u), min(max(v, -half_v), half_v)
    x, y = patch_s[patch] + cos * u - sin * v, sin * u + cos * v
    place[0], place[1] = undevelop(radius, taper, period, length, x, y, patch_a[patch])


@part
def factorise(w: Work, normal: Floats, m: int, damping: float) -> bool:
    """Write the Cholesky factor of the scaled, damped normal matrix; return False if there is none.

    From a damping of ``HOPELESS`` on there is always one: what is not finite is left out of it.
    """
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
            elif damping < HOPELESS:
                return False
            else:
                for t in range(u):
                    factor[u, t] = 0.0
                factor[u, u] = math.sqrt(damping)
    return True


@part
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


@part
def fit(
    lay: Layout, w: Work, link: int, k: int, n: int, max_move: float, max_iterations: int
) -> tuple[float, int, int]:
    """Fit k contacts in ``w.theta`` to the n tactels in ``w.list``; return chi^2, status, iterations.

    ``max_move`` (m) bounds one step on the surface.
    """
    m = 3 * k
    theta, trial, step = w.theta, w.trial, w.step
    normal, gradient = w.normal, w.gradient
    other_normal, other_gradient = w.normal_trial, w.gradient_trial
    chi2, stretched, astray = math.inf, False, 0.0
    damping, gain = FIRST_DAMPING, math.inf
    status = ITERATION_LIMIT
    iterations = 0
    swapped = False
    fresh = True  # the trial is the start: taken as it is
    for c in range(k):
        trial[c, 0], trial[c, 1], trial[c, 2] = theta[c, 0], theta[c, 1], theta[c, 2]
        trial[c, 3] = theta[c, 3]
    while True:
        chi2_trial, stretched_trial, astray_trial = evaluate(
            lay, w, link, trial, k, n, other_normal, other_gradient
        )
        if fresh or (chi2_trial <= chi2 and astray_trial <= astray):
            chi2, stretched, astray = chi2_trial, stretched_trial, astray_trial
            theta, trial = trial, theta
            normal, other_normal = other_normal, normal
            gradient, other_gradient = other_gradient, gradient
            swapped = not swapped
            damping = FIRST_DAMPING if fresh else max(0.1 * damping, 1e-10)
            fresh = False
        else:
            damping *= 10.0

        if gain < NEGLIGIBLE or damping > LAST_DAMPING:
            if not stretched:
                status = CONVERGED
                break
            # settled beyond an owner's reach: on without owners
            for t in range(n):
                w.owner[t] = -1
            for c in range(k):
                trial[c, 0], trial[c, 1], trial[c, 2] = theta[c, 0], theta[c, 1], theta[c, 2]
            fresh, gain = True, math.inf
            continue
        if iterations == max_iterations or is_over(w):
            break
        iterations += 1

        while not factorise(w, normal, m, damping):
            damping = max(10.0 * damping, 1e-8)
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
    if swapped:
        for c in range(k):
            w.theta[c, 0], w.theta[c, 1], w.theta[c, 2] = theta[c, 0], theta[c, 1], theta[c, 2]
    if astray > 0.0:
        status = OFF_SKIN
    elif status == CONVERGED:
        for u in range(m):
            if not normal[u, u] > 0.0:
                status = NO_INFORMATION
    return chi2, status, iterations
