"""One cell of a posterior: the mass of the places in it, with the force that is likeliest there.

What a contact in the cell makes the tactels read is written in parts free of its force; the likelihood is
then maximised over the force by Newton's method, and integrated over it by Laplace's.

Errors are normal or, for a law with a misfit profile, of Student's t. The variance of a reading is sigma^2 +
(misfit p)^2 or, for a law with a misfit profile m(d), sigma^2 + (A m(d))^2; as it depends on place and force,
its logarithm is part of the likelihood. The force has a weak prior: normal in its logarithm about the law's
typical force, by a factor e, or, where a law has none, that of ``FORCE_PRIOR``.

Assumption: the likelihood has one mode over the force, or the start is on the higher one.
Source: D. MacKay, Information Theory, Inference, and Learning Algorithms (2003), 27 (Laplace).
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import DONE
from skinbus.estimate.kernels.board_places import off_board
from skinbus.estimate.kernels.constants import FORCE_PRIOR, FORCE_WIDTH
from skinbus.estimate.kernels.geometry import separation, surface_of
from skinbus.estimate.kernels.law import (
    END,
    KIND,
    POWER,
    PROFILED,
    SLOPE,
    TYPICAL,
    UNSIZED,
    amplitude,
    curved_profile,
    log_force_of,
    misfit_at,
    profile,
    residual_at,
)
from skinbus.estimate.kernels.layout import CONE, Layout
from skinbus.estimate.kernels.least_squares import LOG_FORCE_MAX, LOG_FORCE_MIN
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.jit import inner_kernel
from skinbus.model.bend import bend_at

FORCE_STEPS = 5
"""Most Newton steps in the force of a cell; the start is that of the cell it was divided from."""
LAST_STEP = 0.3
"""Standard deviations of a step that is taken without a look at what it does: what a quadratic leaves of the
log mass there is less than 0.01."""
HOPELESS = 20.0
"""Log mass below the best so far at which a cell is left as it is, its force not yet at its best."""
WIDE_CELL = 1.5e-3
"""m, side from which on the law at both ends of a cell is asked; its curvature describes smaller ones."""
FREEDOM = 5.0
"""Degrees of freedom of Student's t for a law with a misfit profile: the misfit differs from place to place.
Residuals at presses held out have 5 to 8 where a law was learned from 100, 8 and more with 300. With 6 one
place in 500 goes to another mode, beyond 6 of its standard deviations."""
LARGE = 1e200
"""A product of ratios is taken to its logarithm here: one more of them, up to 1e100, does not overflow."""
USUAL_FORCE, USUAL_WIDTH = 4.0, 1.2
"""N, and the standard deviation for a law that was learned from no presses: 0.4 to 40 N, what skins are made
for, are within two standard deviations."""
COARSEST = 0.003
"""m, side of the first cells: a third of a pitch."""


@inner_kernel
def put_cell(
    lay: Layout,
    w: Work,
    link: int,
    c: int,
    n: int,
    to: int,
    s: float,
    a: float,
    side: float,
    across: float,
    log_force: float,
    best: float,
    top: int,
    ahead: float,
) -> bool:
    """Write the cell of this side (m) around (s, a) to row ``to``; return whether it may be the place.

    ``across`` (m) is the side of a cell over which pressures may change, 0 for the middle alone; ``best`` the
    largest log mass so far. Off the skin, or nearer to another tactel than to listed tactel ``top`` by more
    than ``ahead`` (m), is no place.
    """
    if to >= len(w.cell):
        return False
    surface, felt = surface_of(lay.link, link), w.cell_felt
    listed, state, tactel_law = w.list, w.state, lay.law
    home, nearest = -1, math.inf
    for t in range(n):
        i = listed[t]
        d2, felt[t, 5], felt[t, 6] = separation(surface, s, a, lay.s[i], lay.a[i])
        felt[t, 3] = math.sqrt(d2)
        if d2 < nearest:
            home, nearest = i, d2
    place = w.rate
    place[0], place[1] = s, a
    if home < 0 or off_board(lay, link, lay.patch[home], place) > 0.0:
        return False
    if felt[top, 3] > math.sqrt(nearest) + ahead:
        return False
    w.work[DONE] += n
    fill_cell(lay, w, c, n, across)

    laws, lf, typical, width = lay.law_par, log_force, lay.law_par[lay.law[home], TYPICAL], FORCE_WIDTH
    if laws[lay.law[home], UNSIZED] != 0.0:
        typical, width = USUAL_FORCE, USUAL_WIDTH
    if side == COARSEST and laws[lay.law[home], KIND] != CONE:
        # from a force far off, the variance that grows with it may lead further away
        up, down = 0.0, 0.0
        for t in range(n):
            if lay.law[w.list[t]] == lay.law[home]:
                up += felt[t, 0] * felt[t, 4]
                down += felt[t, 0] * felt[t, 0]
        if up > 0.0:
            lf = min(max(log_force_of(laws, lay.law[home], up / down), LOG_FORCE_MIN), LOG_FORCE_MAX)
    value, curvature = 0.0, 0.0
    for turn in range(FORCE_STEPS + 1):
        value, slope, curvature = 0.0, 0.0, 0.0
        if typical > 0.0:
            off = (lf - math.log(typical)) / width
            value -= 0.5 * off * off
            slope -= off / width
            curvature += 1.0 / (width * width)
        else:
            value += FORCE_PRIOR * lf
            slope += FORCE_PRIOR
        # logarithms are taken of products: one for many tactels
        variances, tails = 1.0, 1.0
        last, amp, damp, power = -1, 0.0, 0.0, 0.0
        is_cone, is_profiled = False, False
        for t in range(n):
            i = listed[t]
            law = tactel_law[i]
            is_cut = state[i] == SATURATED
            if law != last:
                amp, damp = amplitude(laws, law, lf)
                last, power = law, laws[law, POWER]
                is_cone, is_profiled = laws[law, KIND] == CONE, laws[law, PROFILED] != 0.0
            p, p_f, scale = amp * felt[t, 0], damp * felt[t, 0], amp
            if is_cone:
                # g = 1 and h = felt[0]: what it reads follows the amplitude, its slope does not
                p, p_f, scale = max(amp * felt[t, 7] + felt[t, 0], 0.0), damp * felt[t, 7], 1.0
                if p == 0.0:
                    p_f = scale = 0.0
            grows = amp * felt[t, 2]
            grows = grows * grows + scale * scale * felt[t, 1]
            variance = felt[t, 8] + grows
            residual = felt[t, 4] - p
            weight = 1.0 / variance
            if is_cut:
                if residual <= 0.0:
                    continue
            else:
                variances *= variance * felt[t, 9]
                if variances > LARGE:
                    value -= 0.5 * math.log(variances)
                    variances = 1.0
            relative = 0.0 if is_cone else 2.0 * power * grows * weight
            if is_profiled:
                q = residual * residual * weight
                tails *= 1.0 + q / (FREEDOM - 2.0)
                if tails > LARGE:
                    value -= 0.5 * (FREEDOM + 1.0) * math.log(tails)
                    tails = 1.0
                weight *= (FREEDOM + 1.0) / (FREEDOM - 2.0 + q)
            else:
                value -= 0.5 * residual * residual * weight
            if not is_cut:
                slope += 0.5 * (residual * residual * weight - 1.0) * relative
                curvature += 0.5 * relative * relative
            slope += residual * p_f * weight
            curvature += p_f * p_f * weight
        value -= 0.5 * math.log(variances) + 0.5 * (FREEDOM + 1.0) * math.log(tails)
        if turn == FORCE_STEPS or not curvature > 0.0:
            break
        move = slope / curvature
        if abs(move) * math.sqrt(curvature) < LAST_STEP:
            value += 0.5 * slope * move
            lf = min(max(lf + move, LOG_FORCE_MIN), LOG_FORCE_MAX)
            break
        if turn > 0 and value + 2.0 * slope * move < best - HOPELESS:
            break
        lf = min(max(lf + min(max(move, -1.5), 1.5), LOG_FORCE_MIN), LOG_FORCE_MAX)
    if not curvature > 0.0:
        return False
    cell = w.cell
    cell[to, 0], cell[to, 1] = s, a
    cell[to, 2] = value - 0.5 * math.log(curvature) + 2.0 * math.log(side)
    cell[to, 3], cell[to, 4], cell[to, 5] = lf, min(1.0 / curvature, 1.0), across
    return True


@inner_kernel
def narrowest_way(lay: Layout, w: Work, n: int, log_force: float) -> float:
    """Return the standard deviation (m) in the direction in which the cell put last is determined best.

    The force is whatever it may be. The slopes are those of the law: a map of residuals is smoother.
    """
    felt, laws = w.cell_felt, lay.law_par
    ss, sa, aa, sf, af, ff = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0 / (FORCE_WIDTH * FORCE_WIDTH)
    last, amp, damp = -1, 0.0, 0.0
    for t in range(n):
        law = lay.law[w.list[t]]
        if law != last:
            amp, damp = amplitude(laws, law, log_force)
            last = law
        scale, p_f, grows = amp, damp * felt[t, 0], amp * felt[t, 2]
        if laws[law, KIND] == CONE:
            scale = 1.0 if amp * felt[t, 7] + felt[t, 0] > 0.0 else 0.0
            p_f = scale * damp * felt[t, 7]
        p_s, p_a = scale * felt[t, 10] * felt[t, 5], scale * felt[t, 10] * felt[t, 6]
        weight = 1.0 / (felt[t, 8] + grows * grows)
        ss += weight * p_s * p_s
        sa += weight * p_s * p_a
        aa += weight * p_a * p_a
        sf += weight * p_s * p_f
        af += weight * p_a * p_f
        ff += weight * p_f * p_f
    ss, sa, aa = ss - sf * sf / ff, sa - sf * af / ff, aa - af * af / ff
    sharpest = 0.5 * (ss + aa) + math.sqrt(0.25 * (ss - aa) * (ss - aa) + sa * sa)
    return 1.0 / math.sqrt(max(sharpest, 1e-300))


@inner_kernel
def fill_cell(lay: Layout, w: Work, c: int, n: int, across: float) -> None:
    """Write to ``cell_felt`` what contact c in a cell makes tactels read, in parts free of its force.

    The variance across the cell is that of the law along the line to the tactel: a third of the square of
    half the difference of its ends, and the square of what they bend from the middle.
    """
    felt, laws, tables = w.cell_felt, lay.law_par, lay.law_table
    wide = w.theta[c, 3]
    narrow = 1.0 / wide
    spread = narrow * narrow
    listed, tactel_law, tactel_narrow, map_of = w.list, lay.law, lay.narrow, lay.map_of
    is_bent, is_mapped = len(lay.bend) > 0, len(lay.map_step) > 0
    for t in range(n):
        i = listed[t]
        law, own, d = tactel_law[i], tactel_narrow[i] * narrow, felt[t, 3]
        if is_bent:
            own *= bend_at(lay.bend, i, felt[t, 5], felt[t, 6])[0]
        felt[t, 1] = felt[t, 2] = 0.0
        along = own / d if d > 0.0 else 0.0
        if laws[law, KIND] == CONE:
            slope = laws[law, SLOPE] * own * spread
            felt[t, 0], felt[t, 7] = -slope * d, spread
            felt[t, 1] = slope * slope * across * across / 12.0
            felt[t, 10] = -laws[law, SLOPE] * spread * along
            continue
        g, g_d, g_dd = curved_profile(laws, tables, law, d * own)
        felt[t, 10] = spread * g_d * along
        if across > 0.0:
            half = 0.5 * across * own
            bend = 0.5 * g_dd * half * half
            half *= g_d
            if across >= WIDE_CELL:
                before, _ = profile(laws, tables, law, abs(d - 0.5 * across) * own)
                after, _ = profile(laws, tables, law, (d + 0.5 * across) * own)
                half, bend = 0.5 * (before - after), 0.5 * (before + after) - g
            felt[t, 1] = spread * spread * (half * half / 3.0 + bend * bend)
        if is_mapped and map_of[i] >= 0 and d * own < laws[law, END]:
            g += residual_at(lay, i, felt[t, 5], felt[t, 6])[0]
        felt[t, 0] = spread * g
        if laws[law, PROFILED] != 0.0 or laws[law, UNSIZED] != 0.0:
            felt[t, 2] = spread * misfit_at(laws, tables, law, d * narrow)
