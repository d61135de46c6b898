"""Damped least squares of the contact law: the most likely places and forces of a given number of contacts.

::

    minimise  chi^2 = sum_j w_j (p_j - sum_k p_law(d_jk, F_k))^2      over (s_k, a_k, log F_k)

over the listed tactels, silent ones too: zero is information. A contact may be wider than the law, by a
factor w >= 1 that is held here: it makes p(d / w) / w^2, the same force on more skin. A saturated
reading counts only while the law predicts less than its limit. A law that ends at its reach pulls at no
tactel beyond, so a touched tactel first has an owner, one contact whose law goes on below zero there;
when the fit has settled with a tactel still beyond its reach, it goes on without owners. Steps are those of
Levenberg and Marquardt, with a damping in proportion to the diagonal: units do not matter.

Assumption: errors of the readings are normal and independent. Failure: a local minimum; the start
decides, which is why clustering comes first. The iterations are bounded and the outcome is a status.
Source: J. Nocedal, S. Wright, Numerical Optimization (2006), 10.3; the law in ``kernels.law``.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import DONE, lacks_time_for
from skinbus.estimate.kernels.board_places import off_board
from skinbus.estimate.kernels.geometry import flat_of, separation, surface_of
from skinbus.estimate.kernels.law import amplitude, is_plain, pressure, pressure_beyond, reach, residual_at
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.normal_equations import write_normal
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.jit import inner_kernel
from skinbus.model.bend import bend_at

CONVERGED, ITERATION_LIMIT, NO_INFORMATION, OFF_SKIN, GIVEN_UP = 0, 1, 2, 3, 4
"""Status of a fit: at a minimum; stopped by the limit; some parameter has no effect; a place off the skin; a
search that cannot come where it should."""

MAX_ITERATIONS = 40
FIRST_DAMPING, LAST_DAMPING = 1e-4, 1e10
NEGLIGIBLE = 1e-7
"""Expected decrease of chi^2 at which a fit ends: a step of 3e-4 standard deviations."""
ROUGH = 0.01
"""The same for a search, whose answer is fitted again: a tenth of a standard deviation."""
GLANCE, PROMISE = 3, 4.0
"""Iterations after which a search may be given up, where its chi^2 would not be low enough even if it fell by
so many times what the next step promises: the first steps are too long for their lines."""
TRUSTED = 0.1
"""Damping up to which a step promises what is to be had; a damped one promises less."""
AT_EDGE = 2.5e-3
"""The same, of a step that has not lowered chi^2, however short: the minimum is at an edge of the law, a
tactel at the end of its reach, and steps only go to and fro."""
UNSEEN, UNSEEN_PLACE, UNSEEN_LOG_FORCE = 2.5e-3, 1e-5, 1e-3
"""A step that promises less than this, a twentieth of a standard deviation, and is no larger (m, 1), is the
last, taken without a look at what it does to chi^2: the next would be a fiftieth as long."""
MAX_LOG_STEP = 1.0
"""A step changes a force by at most a factor e: beyond, the law is not the line that the step assumes."""
HOPELESS = 1e20
"""Damping at which a unit diagonal outweighs every entry: a pivot that is still not positive is no number."""
SINGULAR = 1e-14
"""Part of the diagonal that a pivot must keep: what rounding leaves of a parameter that others stand for."""
LOG_FORCE_MIN, LOG_FORCE_MAX = -46.0, 46.0
"""1e-20 N to 1e20 N: any skin is inside, and no power of it leaves the range of floats."""


@inner_kernel
def evaluate(
    lay: Layout, w: Work, link: int, theta: Floats, k: int, n: int, normal: Floats, gradient: Floats
) -> tuple[float, bool, float]:
    """Return what :func:`predict` does; write J'WJ (its lower half) and J'Wr."""
    seen = predict(lay, w, link, theta, k, n)
    write_normal(w, k, normal, gradient)
    return seen


@inner_kernel
def predict(lay: Layout, w: Work, link: int, theta: Floats, k: int, n: int) -> tuple[float, bool, float]:
    """Return chi^2 of k contacts ``theta`` on the n listed tactels.

    Also returns whether any tactel is out of its owner's reach, and how far (m) a contact is off the skin.
    """
    extrapolated = False
    for t in range(n):
        w.predicted[t] = w.background[t]
    plain = is_plain(lay, link)
    for c in range(k):
        extrapolated |= press(lay, w, link, theta, c, n, 1) if plain else press(lay, w, link, theta, c, n, 0)
    w.work[DONE] += n * k
    chi2 = 0.0
    measured, state, listed, predicted = w.p, w.state, w.list, w.predicted
    weights, counts, pull = w.weight, w.counts, w.pull
    for t in range(n):
        i = listed[t]
        residual = measured[i] - predicted[t]
        if state[i] == SATURATED and residual <= 0.0:
            counts[t] = pull[t] = 0.0
            continue
        counts[t] = weights[t]
        pull[t] = weights[t] * residual
        chi2 += pull[t] * residual
    return chi2, extrapolated, off_skin(lay, w, link, theta, k)


@inner_kernel
def off_skin(lay: Layout, w: Work, link: int, theta: Floats, k: int) -> float:
    """Return how far (m) one of k contacts is off the board of the tactel nearest to it; 0 on them."""
    off_by = 0.0
    for c in range(k):
        if w.nearest_tactel[c] < 0:
            return math.inf
        off_by = max(off_by, off_board(lay, link, lay.patch[w.nearest_tactel[c]], theta[c]))
    return off_by


@inner_kernel
def press(lay: Layout, w: Work, link: int, theta: Floats, c: int, n: int, plain: int) -> bool:
    """Add the pressure of contact c of ``theta`` to ``predicted``; list the tactels it reaches, ``felt_at``.

    For each, ``felt`` has the row of the Jacobian, and its pressure. ``plain``, a literal, is that of
    :func:`is_plain`: the kernel is compiled for each. Returns whether any tactel is out of its owner's reach.
    """
    surface = flat_of(lay.link, link) if plain else surface_of(lay.link, link)
    laws, tables, tactel_law, map_of = lay.law_par, lay.law_table, lay.law, lay.map_of
    measured, listed, owner, predicted = w.p, w.list, w.owner, w.predicted
    at_s, at_a, tactel_narrow, felt_at, felt = w.listed_s, w.listed_a, w.listed_narrow, w.felt_at, w.felt
    s, a, log_force, narrow = theta[c, 0], theta[c, 1], theta[c, 2], 1.0 / theta[c, 3]
    spread = narrow * narrow
    extrapolated = False
    is_bent, is_mapped = not plain and len(lay.bend) > 0, not plain and len(lay.map_step) > 1
    home, nearest, m = -1, math.inf, 0
    last, amp, damp, far, furthest = -1, 0.0, 0.0, 0.0, 0.0
    for t in range(n):
        law = 0 if plain else tactel_law[listed[t]]
        if law != last:
            amp, damp = amplitude(laws, law, log_force)
            far = reach(laws, law, amp) * theta[c, 3]
            last, furthest = law, max(furthest, far)
        d2, x, y = separation(surface, s, a, at_s[t], at_a[t])
        if d2 < nearest:
            nearest, home = d2, t
        own, own_s, own_a = tactel_narrow[t], 0.0, 0.0
        if is_bent:
            factor, own_s, own_a = bend_at(lay.bend, listed[t], x, y)
            own, own_s, own_a = own * factor, own * own_s, own * own_a
        is_felt = d2 * own * own <= far * far
        if not is_felt and owner[t] != c:
            continue
        i = listed[t]
        d = math.sqrt(d2)
        per_d = 1.0 / d if d > 0.0 else 0.0
        if is_felt:
            p, p_d, p_amp = pressure(laws, tables, law, amp, d * narrow * own)
            p_own = p_d * d * narrow
            p_d *= own
        else:
            extrapolated = True
            p, p_d, p_amp = pressure_beyond(laws, law, amp, d * narrow, measured[i])
            p_own = 0.0
        slope = p_d * spread * narrow * per_d
        p_s, p_a = slope * x, slope * y
        if is_bent:
            p_s, p_a = p_s + spread * p_own * own_s, p_a + spread * p_own * own_a
        if is_mapped and map_of[i] >= 0:
            r, r_s, r_a = residual_at(lay, i, x, y)
            p += amp * r
            p_amp += r
            p_s += spread * amp * r_s
            p_a += spread * amp * r_a
        predicted[t] += spread * p
        felt_at[c, m] = t
        felt[c, m, 0], felt[c, m, 1], felt[c, m, 2] = p_s, p_a, spread * p_amp * damp
        felt[c, m, 3] = spread * p
        m += 1
    w.nearest_tactel[c], w.n_felt[c], w.far[c] = listed[home] if home >= 0 else -1, m, furthest
    return extrapolated


@inner_kernel
def factorise(w: Work, normal: Floats, m: int, damping: float) -> bool:
    """Write L and 1/D of the damped normal matrix L D L' to ``factor`` and ``pivot``; False if it has none.

    Damping is relative to the diagonal, and so is what counts as a positive pivot: units do not matter. From
    a damping of ``HOPELESS`` on there is always a factor: what is not finite is left out of it.
    """
    factor, pivot = w.factor, w.pivot
    if m == 3 and factorise_one(w, normal, damping):
        return True
    for u in range(m):
        known = normal[u, u] > 0.0
        x = normal[u, u] * (1.0 + damping) if known else 1.0
        for v in range(u):
            factor[u, v] = normal[u, v] if known else 0.0
        for v in range(u):
            y = factor[u, v]
            below = y * pivot[v]
            for t in range(v + 1, u):  # sums side by side, for a sum is as slow as its additions in turn
                factor[u, t] -= below * factor[v, t]
            factor[v, u] = y  # L D above the diagonal
            factor[u, v] = below
            x -= y * below
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
def factorise_one(w: Work, normal: Floats, damping: float) -> bool:
    """Do the same for one contact, most are alone, without loops; False where a pivot is not positive."""
    factor, pivot, more = w.factor, w.pivot, 1.0 + damping
    n00, n10, n11 = normal[0, 0], normal[1, 0], normal[1, 1]
    n20, n21, n22 = normal[2, 0], normal[2, 1], normal[2, 2]
    if not (n00 > 0.0) & (n11 > 0.0) & (n22 > 0.0):
        return False
    p0 = 1.0 / (n00 * more)
    l10, l20 = n10 * p0, n20 * p0
    x1 = n11 * more - n10 * l10
    p1 = 1.0 / x1
    n21 -= l20 * n10
    l21 = n21 * p1
    x2 = n22 * more - n20 * l20 - n21 * l21
    if not (n00 * more > SINGULAR * n00) & (x1 > SINGULAR * n11) & (x2 > SINGULAR * n22):
        return False
    pivot[0], pivot[1], pivot[2] = p0, p1, 1.0 / x2
    factor[1, 0], factor[2, 0], factor[2, 1] = l10, l20, l21
    factor[0, 1], factor[0, 2], factor[1, 2] = n10, n20, n21
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
    lay: Layout, w: Work, link: int, k: int, n: int, max_move: float, limit: int, rough: float, beat: float
) -> tuple[float, int, int]:
    """Fit k contacts in ``w.theta`` to the n tactels in ``w.list``; return chi^2, status, iterations.

    ``max_move`` (m) bounds one step, ``limit`` their number. A search ends where a step promises less than
    ``rough`` times what a tactel is expected to leave, or leaves, and is given up where chi^2 cannot come
    below ``beat``; then chi^2 and status are all that is right. An answer has ``rough`` 0, ``beat`` infinity.
    What :func:`evaluate` writes is that of the answer afterwards, or of the place a last, negligible step
    before it, without owners.
    """
    start = evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
    chi2, status, iterations, _, _ = descend(lay, w, link, k, n, max_move, limit, rough, beat, start)
    return chi2, status, iterations


@inner_kernel
def descend(
    lay: Layout,
    w: Work,
    link: int,
    k: int,
    n: int,
    max_move: float,
    limit: int,
    rough: float,
    beat: float,
    start: tuple[float, bool, float],
) -> tuple[float, int, int, tuple[float, bool, float], bool]:
    """Do the same from contacts evaluated last, of which that has returned ``start``.

    Also returns the same of the contacts it leaves, and whether they were evaluated last.
    """
    m = 3 * k
    theta, trial, step = w.theta, w.trial, w.step
    normal, gradient = w.normal, w.gradient
    chi2, extrapolated, off_by = start
    damping, gain = FIRST_DAMPING, math.inf
    status = ITERATION_LIMIT
    iterations = 0
    swapped, taken, moved = False, True, False
    for c in range(k):
        trial[c, 3] = theta[c, 3]
    while True:
        at_edge = gain < AT_EDGE and not taken
        # owners are there to bring a contact to its tactels, no matter to what place exactly
        settled = gain < (ROUGH if extrapolated else NEGLIGIBLE)
        if settled or at_edge or damping > LAST_DAMPING:
            if not extrapolated:
                status = CONVERGED
                break
            # settled beyond an owner's reach: on without owners
            for t in range(n):
                w.owner[t] = -1
            chi2, extrapolated, off_by = evaluate(lay, w, link, theta, k, n, normal, gradient)
            damping, gain, taken = FIRST_DAMPING, math.inf, True
        if iterations == limit or lacks_time_for(w, k * n):
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
            trial[c, 0] = theta[c, 0] + shrink * step[u]
            trial[c, 1] = theta[c, 1] + shrink * step[u + 1]
            trial[c, 2] = min(max(theta[c, 2] + shrink * step[u + 2], LOG_FORCE_MIN), LOG_FORCE_MAX)
            largest = max(largest, move2, (step[u + 2] * (UNSEEN_PLACE / UNSEEN_LOG_FORCE)) ** 2)
        is_trusted = damping <= TRUSTED
        if is_trusted and not extrapolated:
            if iterations > GLANCE and chi2 - PROMISE * gain > beat:
                return chi2, GIVEN_UP, iterations, start, False
            if gain < rough * max(1.0, chi2 / n):
                status = CONVERGED
                break
        unseen = gain < (UNSEEN if is_trusted else NEGLIGIBLE) and not extrapolated
        unseen &= largest < UNSEEN_PLACE * UNSEEN_PLACE
        if unseen and off_skin(lay, w, link, trial, k) <= off_by:
            for c in range(k):
                theta[c, 0], theta[c, 1], theta[c, 2] = trial[c, 0], trial[c, 1], trial[c, 2]
                gradient[3 * c] = gradient[3 * c + 1] = gradient[3 * c + 2] = 0.0
            status, moved = CONVERGED, True
            break

        chi2_trial, extrapolated_trial, off_by_trial = predict(lay, w, link, trial, k, n)
        taken = chi2_trial <= chi2 and off_by_trial <= off_by
        if taken:  # else the normal equations are not used
            write_normal(w, k, normal, gradient)
            chi2, extrapolated, off_by = chi2_trial, extrapolated_trial, off_by_trial
            theta, trial = trial, theta
            swapped = not swapped
            damping = max(0.1 * damping, 1e-10)
        else:
            damping *= 10.0
    if swapped:
        for c in range(k):
            w.theta[c, 0], w.theta[c, 1], w.theta[c, 2] = theta[c, 0], theta[c, 1], theta[c, 2]
    here = chi2, extrapolated, off_by
    if extrapolated or not taken:
        for t in range(n):
            w.owner[t] = -1
        here = evaluate(lay, w, link, w.theta, k, n, normal, gradient)
        moved = False
    if off_by > 0.0:
        status = OFF_SKIN
    elif status == CONVERGED:
        for u in range(m):
            if not w.normal[u, u] > 0.0:
                status = NO_INFORMATION
    return chi2, status, iterations, here, not moved
