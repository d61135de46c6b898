"""Contacts that may be long: where else they would be, were they bars.

Near and beyond the outermost tactels of a board, a bar of which a part lies in the gap reads like a finger
several millimetres from its middle. The second moments of ``contact_shape`` are too small a change for that.
So the readings are explained by a bar instead: three equal discs of one size in a row, ::

    p_i = F / 3 (k_u(|x_i - x + e|) + k_u(|x_i - x|) + k_u(|x_i - x - e|))

with place x, log force, half length e and size u unknown, by a few damped Gauss-Newton steps from bars that
point over the rim, along it and diagonally. Each bar and the contact have a share by chi^2 and prior; the
covariance has the squares of the ways to the bars, as shares of a mixture. The contact stays where it is, and
is flagged where it is a bar for certain that lies elsewhere.

Assumption: one press alone, so that all readings around it are its own. Failure: of bars of 30 to 40 mm that
show the tactels one end alone, in one of 30 presses, most are further off than their deviation.
Source: D. Titterington, A. Smith, U. Makov, Statistical Analysis of Finite Mixture Distributions (1985), 2.
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.board_places import in_board
from skinbus.estimate.kernels.covariance import PRIOR_LOG_FORCE, PRIOR_PLACE
from skinbus.estimate.kernels.disc_shapes import FINGERS, SHARES, SIZES, SPREADS
from skinbus.estimate.kernels.geometry import separation, surface_of
from skinbus.estimate.kernels.law import SHAPED, UNSIZED, amplitude, profile, shape_change
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.least_squares import MAX_LOG_STEP, factorise, solve_step
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.estimate.levels.sized_answers import LARGEST, SMALLEST
from skinbus.jit import inner_kernel, runtime_int

BARS = ((1.0, 0.0), (math.sqrt(0.5), -math.sqrt(0.5)), (math.sqrt(0.5), math.sqrt(0.5)), (0.0, 1.0))
"""Cosine and sine of the directions of first bars to that over the rim: along the rim a bar shows itself."""
BAR_SHARE = 0.15
"""Prior share of bars, of what is long and of fingers that lie flat."""
HALF, HALF_SPREAD = 8e-3, 4e-3
"""m, prior of e: bars of 20 to 40 mm, less the discs that make them."""
BAR_SIZE, BAR_SIZE_SPREAD = -0.2, 0.35
"""Prior of u: bars are 2 to 16 mm wide."""
WITHIN = 5e-3
"""m, half a pitch within the outermost tactels: further in, four tactels and more show that a bar is long."""
AROUND = 0.022
"""m, two pitches: beyond, tactels read little of either; those within show where the rim is."""
OUT, OPEN = 4e-3, 0.4
"""m by which the middle of a bar over the rim is further out than the contact, and that of one along the rim
further in, where so much of the mean direction of tactels is left: of one beyond the outermost it is 0.6."""
MORE, MORE_OUT = 0.1, 0.2
"""By which the log of the force of a bar is larger, and more so over the rim, less along it."""
PARAMETERS = 6
"""s, a, log force, size, e along s and a."""
BAR_STEPS = 4
"""With six the shares of bars over gaps are those of four."""
TRIED, HOPELESS = 2, 25.0
"""After so many steps a bar is given up that would be so much worse in chi^2."""
BAR_DAMPING = 0.02
NEGLIGIBLE = 0.3
"""chi^2 that a step must promise."""
MOST_PLACE, MOST_SIZE = 6e-3, 0.5
"""m, 1: no step is longer."""
FAR = 3.0
"""Standard deviations of a contact as a round one."""
SURE = 0.9
"""Share of far bars from which on a contact is flagged: no finger of 12 mm in 300 is."""


@inner_kernel
def weigh_bars(lay: Layout, w: Work, link: int, n: int, size: float) -> int:
    """Solve for bars in place of the only contact in ``theta``, as evaluated last; return how many there are.

    ``rival_theta`` has s, a, log force and share of each. ``size`` is that of the contact.
    """
    home = w.nearest_tactel[0]
    laws, law = lay.law_par, lay.law[home]
    if (
        laws[law, UNSIZED] == 0.0
        or laws[law, SHAPED] == 0.0
        or is_within(lay, link, lay.patch[home], w.theta[0])
    ):
        return 0
    surface, s, a = surface_of(lay.link, link), w.theta[0, 0], w.theta[0, 1]
    out_s, out_a, near, chi2 = 0.0, 0.0, runtime_int(0), 0.0
    for t in range(n):
        i = w.list[t]
        d2, x, y = separation(surface, s, a, lay.s[i], lay.a[i])
        if d2 > AROUND * AROUND:
            continue
        chi2 += w.pull[t] * (w.p[i] - w.predicted[t])
        per_d = 1.0 / max(math.sqrt(d2), 1e-9)
        out_s, out_a = out_s + x * per_d, out_a + y * per_d
        w.felt_at[1, near], w.felt[1, near, 0], w.felt[1, near, 1] = t, x, y
        near += 1
    way = math.sqrt(out_s * out_s + out_a * out_a)
    if near == 0 or not way > 0.0:
        return 0
    out_s, out_a, is_open = out_s / way, out_a / way, min(way / (OPEN * near), 1.0)
    prior = 0.0
    for j in range(len(SIZES)):
        off = (size - SIZES[j]) / SPREADS[j]
        prior += SHARES[j] / SPREADS[j] * math.exp(-0.5 * off * off)
    chi2 -= 2.0 * math.log(max(prior * SPREADS[0] / FINGERS, 1e-300))
    theta, answers, total = w.trial, w.rival_theta, 1.0 - BAR_SHARE
    for j in range(len(BARS)):
        cos, sin = BARS[j]
        over = cos * cos - sin * sin
        theta[0, 0], theta[0, 1] = OUT * over * is_open * out_s, OUT * over * is_open * out_a
        theta[0, 2], theta[0, 3] = w.theta[0, 2] + MORE + MORE_OUT * over, BAR_SIZE
        theta[1, 0], theta[1, 1] = HALF * (cos * out_s - sin * out_a), HALF * (cos * out_a + sin * out_s)
        worse = solve_bar(lay, w, near, chi2 + HOPELESS) - chi2
        share = BAR_SHARE / len(BARS) * math.exp(-0.5 * max(worse, -600.0))
        answers[0, j, 0], answers[0, j, 1], answers[0, j, 2] = theta[0, 0], theta[0, 1], theta[0, 2]
        answers[0, j, 3] = share
        total += share
    for j in range(len(BARS)):
        answers[0, j, 3] /= total
    return len(BARS)


@inner_kernel
def is_within(lay: Layout, link: int, patch: int, place: Floats) -> bool:
    """Return whether a place (s, a) is well within the outermost tactels of a board."""
    u, v = in_board(lay, link, patch, place[0], place[1])
    return bool(abs(u) <= lay.extent[patch, 0] - WITHIN and abs(v) <= lay.extent[patch, 1] - WITHIN)


@inner_kernel
def solve_bar(lay: Layout, w: Work, near: int, worst: float) -> float:
    """Solve for the bar in ``trial``, its place from that of the contact on; return its chi^2.

    It is that which the last step promises. A bar is given up where it promises more than ``worst``.
    """
    theta, other, step = w.trial, w.wide, w.step
    normal, gradient, damping = w.normal, w.gradient, BAR_DAMPING
    chi2 = evaluate_bar(lay, w, theta, near, normal, gradient)
    best = chi2
    for turn in range(BAR_STEPS):
        while not factorise(w, normal, PARAMETERS, damping):
            damping *= 10.0
        solve_step(w, gradient, PARAMETERS)
        gain = 0.0
        for x in range(PARAMETERS):
            gain += step[x] * gradient[x]
        most = max(max(abs(step[0]), abs(step[1])), max(abs(step[4]), abs(step[5])))
        shrink = min(
            min(1.0, MOST_PLACE / max(most, 1e-300)),
            min(MAX_LOG_STEP / max(abs(step[2]), 1e-300), MOST_SIZE / max(abs(step[3]), 1e-300)),
        )
        gain *= shrink * (2.0 - shrink)
        best = chi2 - gain
        if gain < NEGLIGIBLE or (turn >= TRIED and best > worst):
            break
        for x in range(4):
            other[0, x] = theta[0, x] + shrink * step[x]
        other[0, 3] = min(max(other[0, 3], SMALLEST), LARGEST)
        for x in range(2):
            other[1, x] = theta[1, x] + shrink * step[4 + x]
        is_last = turn == BAR_STEPS - 1
        trial = best
        if not is_last:
            trial = evaluate_bar(lay, w, other, near, w.normal_trial, w.gradient_trial)
        if is_last or trial < chi2:
            chi2 = trial
            damping *= 0.2
            for x in range(4):
                theta[0, x] = other[0, x]
            theta[1, 0], theta[1, 1] = other[1, 0], other[1, 1]
            for x in range(PARAMETERS):
                gradient[x] = w.gradient_trial[x]
                for y in range(x + 1):
                    normal[x, y] = w.normal_trial[x, y]
        else:
            damping = max(10.0 * damping, 0.1)
    return best


@inner_kernel
def evaluate_bar(lay: Layout, w: Work, at: Floats, near: int, normal: Floats, gradient: Floats) -> float:
    """Return chi^2 of a bar with its prior; write its normal equations.

    ``at`` has the way (s, a) from the contact in ``theta``, log force and size, and in the next row e. Row 1
    of ``felt`` has the ways to the contact from the tactels near it, ``felt_at`` what they are.
    """
    laws, tables, size = lay.law_par, lay.law_table, at[0, 3]
    e_s, e_a = at[1, 0], at[1, 1]
    for x in range(PARAMETERS):
        gradient[x] = 0.0
        for y in range(x + 1):
            normal[x, y] = 0.0
    chi2, last, amp, damp = 0.0, -1, 0.0, 0.0
    for m in range(near):
        t = w.felt_at[1, m]
        i = w.list[t]
        x0, y0, narrow, law = (
            w.felt[1, m, 0] + at[0, 0],
            w.felt[1, m, 1] + at[0, 1],
            lay.narrow[i],
            lay.law[i],
        )
        if law != last:
            last = law
            amp, damp = amplitude(laws, law, at[0, 2])
            amp, damp = amp / 3.0, damp / 3.0
        p = f0 = f1 = f3 = f4 = f5 = 0.0
        for disc in range(3):
            c = disc - 1.0
            x, y = x0 + c * e_s, y0 + c * e_a
            d = math.sqrt(x * x + y * y)
            k, k_d = profile(laws, tables, law, d * narrow)
            g, g_d, g_size = shape_change(laws, tables, law, d * narrow, size)
            slope = narrow * (k_d + g_d) / max(d, 1e-9)
            p += k + g
            f0 += slope * x
            f1 += slope * y
            f3 += g_size
            f4 += c * slope * x
            f5 += c * slope * y
        residual = w.p[i] - w.background[t] - amp * p
        if w.state[i] == SATURATED and residual <= 0.0:
            continue
        weight = w.weight[t]
        pull, f2 = weight * residual, damp * p
        chi2 += pull * residual
        f0, f1, f3, f4, f5 = amp * f0, amp * f1, amp * f3, amp * f4, amp * f5
        gradient[0] += f0 * pull
        gradient[1] += f1 * pull
        gradient[2] += f2 * pull
        gradient[3] += f3 * pull
        gradient[4] += f4 * pull
        gradient[5] += f5 * pull
        normal[0, 0] += weight * f0 * f0
        normal[1, 0] += weight * f1 * f0
        normal[1, 1] += weight * f1 * f1
        normal[2, 0] += weight * f2 * f0
        normal[2, 1] += weight * f2 * f1
        normal[2, 2] += weight * f2 * f2
        normal[3, 0] += weight * f3 * f0
        normal[3, 1] += weight * f3 * f1
        normal[3, 2] += weight * f3 * f2
        normal[3, 3] += weight * f3 * f3
        normal[4, 0] += weight * f4 * f0
        normal[4, 1] += weight * f4 * f1
        normal[4, 2] += weight * f4 * f2
        normal[4, 3] += weight * f4 * f3
        normal[4, 4] += weight * f4 * f4
        normal[5, 0] += weight * f5 * f0
        normal[5, 1] += weight * f5 * f1
        normal[5, 2] += weight * f5 * f2
        normal[5, 3] += weight * f5 * f3
        normal[5, 4] += weight * f5 * f4
        normal[5, 5] += weight * f5 * f5
    for x in range(2):
        normal[x, x] += 1.0 / (PRIOR_PLACE * PRIOR_PLACE)
    normal[2, 2] += 1.0 / (PRIOR_LOG_FORCE * PRIOR_LOG_FORCE)
    off = (size - BAR_SIZE) / BAR_SIZE_SPREAD
    chi2 += off * off
    gradient[3] -= off / BAR_SIZE_SPREAD
    normal[3, 3] += 1.0 / (BAR_SIZE_SPREAD * BAR_SIZE_SPREAD)
    half = max(math.sqrt(e_s * e_s + e_a * e_a), 1e-9)
    off = (half - HALF) / HALF_SPREAD
    chi2 += off * off
    to_s, to_a = e_s / half, e_a / half
    gradient[4] -= off / HALF_SPREAD * to_s
    gradient[5] -= off / HALF_SPREAD * to_a
    spread, turned = 1.0 / (HALF_SPREAD * HALF_SPREAD), 1.0 / (PRIOR_PLACE * PRIOR_PLACE)
    normal[4, 4] += spread * to_s * to_s + turned
    normal[5, 4] += spread * to_s * to_a
    normal[5, 5] += spread * to_a * to_a + turned
    return float(chi2)


@inner_kernel
def allow_for_bars(w: Work, n_bars: int) -> float:
    """Add to ``normal_trial``, the covariance of the only contact in ``theta``, the ways to the bars.

    Returns the share of those that are ``FAR`` in its own deviations.
    """
    moment, answers, force = w.normal_trial, w.rival_theta, math.exp(w.theta[0, 2])
    far, c00, c01, c11 = 0.0, moment[0, 0], moment[0, 1], moment[1, 1]
    det = c00 * c11 - c01 * c01
    for j in range(n_bars):
        share, off_s, off_a = answers[0, j, 3], answers[0, j, 0], answers[0, j, 1]
        off_f = math.exp(answers[0, j, 2]) - force
        if c11 * off_s * off_s - 2.0 * c01 * off_s * off_a + c00 * off_a * off_a > FAR * FAR * det:
            far += share
        moment[0, 0] += share * off_s * off_s
        moment[1, 0] += share * off_s * off_a
        moment[1, 1] += share * off_a * off_a
        moment[2, 0] += share * off_s * off_f
        moment[2, 1] += share * off_a * off_f
        moment[2, 2] += share * off_f * off_f
    moment[0, 1], moment[0, 2], moment[1, 2] = moment[1, 0], moment[2, 0], moment[2, 1]
    return far
