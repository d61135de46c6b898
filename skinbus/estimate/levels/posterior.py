"""The posterior of a contact whose place the tactels determine badly, integrated over cells of the surface.

Between the tactels of a coarse array a contact is strong and far from one, or weak and near: its likelihood
has several modes, or one that bends, and no curvature describes it. Here the plane around the tactel that
reads most is divided into square cells. The mass of a cell is the likelihood at its middle, maximised over
the force, times the width of that maximum (Laplace) and the prior; the change of the pressures across the
cell is added to their variance, so that a mode narrower than a cell is not missed between two. Cells that
may hold mass are divided into four, until they are finer than the mode in its narrowest direction. The answer
is the posterior mean, which has the least expected squared error, and the covariance is that of all cells.

Errors are normal or, for a law with a misfit profile, of Student's t. The variance of a reading is sigma^2 +
(misfit p)^2 or, for a law with a misfit profile m(d), sigma^2 + (A m(d))^2; as it depends on place and force,
its logarithm is part of the likelihood. The force has a weak prior: normal in its logarithm about the law's
typical force, by a factor e, or, where a law has none, that of ``FORCE_PRIOR``.

Assumption: the contacts around are where they were fitted. Failure: more cells than ``CELLS``; then the
coarser cells that are left stand for themselves.
Source: D. MacKay, Information Theory, Inference, and Learning Algorithms (2003), 27 (Laplace), 29.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import DONE, is_over
from skinbus.estimate.kernels.constants import FORCE_PRIOR
from skinbus.estimate.kernels.geometry import separation, surface_of, wrap
from skinbus.estimate.kernels.groups import add_background, list_tactels
from skinbus.estimate.kernels.law import (
    KIND,
    MISFIT,
    POINTS,
    POWER,
    PROFILED,
    SLOPE,
    STEP,
    TYPICAL,
    amplitude,
    log_force_of,
    misfit_at,
    profile,
    residual_at,
)
from skinbus.estimate.kernels.layout import CONE, Layout
from skinbus.estimate.kernels.least_squares import LOG_FORCE_MAX, LOG_FORCE_MIN, evaluate, off_board
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.estimate.levels.split_merge import clear_owners
from skinbus.jit import inner_kernel, runtime_int

UNSURE = 0.25e-3
"""m, standard deviation of a place from which on it is integrated: a mode so long bends; shorter ones are
normal to a few per cent."""
FEW = 5
"""A contact that reaches fewer tactels is integrated, too: other places may explain them as well."""
AROUND = 0.012
"""m, from the tactel that reads most: a contact further away would have another one nearest."""
COARSEST = 0.003
"""m, side of the first cells: a third of a pitch."""
DIVISIONS = 6
"""Most divisions of a cell: down to 0.05 mm."""
FINE = 0.8
"""Standard deviations of the narrowest mode that a cell may measure."""
NOTHING = 7.0
"""Log mass below that of the best cell at which a cell is not divided: a part of 1e-3."""
FORCE_STEPS = 5
"""Iterations in the force of a cell; the start is that of the cell it was divided from."""
FREEDOM = 4.0
"""Degrees of freedom of Student's t for a law with a misfit profile: the misfit differs from place to place,
so that one tactel in a hundred is 4 standard deviations off."""
LARGE = 1e200
"""A product of ratios is taken to its logarithm here: one more of them, up to 1e100, does not overflow."""
FORCE_WIDTH = 1.0
"""Standard deviation of the prior of log force: a factor e. Loads of one use of a skin (a hand, a tip) vary
by as much; it decides only where readings leave a factor of several open."""


@inner_kernel
def integrate_contacts(lay: Layout, w: Work, link: int, k: int, level: int) -> bool:
    """Replace place, force and covariance of contacts just stored that are badly determined.

    Only where the law of the board has a misfit profile: it says what other places may explain.
    At the level above ``fit`` this is for a contact alone; those of several have their own ways there.
    """
    done = False
    if k > 1 and level > 1:
        return done
    for c in range(k):
        to = w.members[c]
        ss, sa, aa = w.covariance[to, 0, 0], w.covariance[to, 0, 1], w.covariance[to, 1, 1]
        longest = 0.5 * (ss + aa) + math.sqrt(0.25 * (ss - aa) * (ss - aa) + sa * sa)
        if w.n_tactels[to] >= FEW and longest < UNSURE * UNSURE:
            continue
        if is_over(w) or w.nearest_tactel[c] < 0:
            continue
        if lay.law_par[lay.law[w.nearest_tactel[c]], PROFILED] == 0.0:
            continue  # without a profile the law is held for true, and the mode that was found for the one
        if not done:
            n = list_tactels(lay, w, link, k, 0.0, AROUND + COARSEST, 0.0)
            add_background(lay, w, link, w.group[w.members[0]], k, n)
            clear_owners(w, n)
            evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
            done = True
        integrate(lay, w, link, c, n)
    return done


@inner_kernel
def integrate(lay: Layout, w: Work, link: int, c: int, n: int) -> bool:
    """Write the posterior mean and covariance of contact c to its columns; return whether there is one."""
    n_cells, side = divide(lay, w, link, c, n)
    return n_cells > 0 and summarise(w, c, n_cells, surface_of(lay.link, link).period, side)


@inner_kernel
def restart(lay: Layout, w: Work, link: int, c: int, n: int) -> bool:
    """Put contact c of ``theta``, evaluated last, to the middle of the cell with the most mass.

    It has the law's own width then. Returns whether there is such a cell.
    """
    theta, cell = w.theta, w.cell
    theta[c, 3] = 1.0
    n_cells, _ = divide(lay, w, link, c, n)
    best = runtime_int(-1)
    for o in range(n_cells):
        if best < 0 or cell[o, 2] > cell[best, 2]:
            best = o
    if best < 0 or cell[best, 2] == -math.inf:
        return False
    theta[c, 0], theta[c, 1], theta[c, 2] = cell[best, 0], cell[best, 1], cell[best, 3]
    return True


@inner_kernel
def divide(lay: Layout, w: Work, link: int, c: int, n: int) -> tuple[int, float]:
    """Divide the plane around contact c of ``theta``, evaluated last, into cells; return how many.

    Also returns the side (m) of the finest. Cells that were divided have no mass.
    """
    cell, theta = w.cell, w.theta
    surface = surface_of(lay.link, link)
    # what the other contacts press on these tactels
    for t in range(n):
        i = w.list[t]
        w.cell_felt[t, 4] = w.p[i] - w.predicted[t]
        wrong = lay.law_par[lay.law[i], MISFIT] * w.p[i]
        w.cell_felt[t, 10] = lay.sigma[i] * lay.sigma[i] + wrong * wrong
    for m in range(w.n_felt[c]):
        w.cell_felt[w.felt_at[c, m], 4] += w.felt[c, m, 3]
    top, most = -1, 0.0
    for t in range(n):
        if w.cell_felt[t, 4] > most:
            top, most = t, w.cell_felt[t, 4]
    if top < 0:
        return 0, 0.0
    s0, a0 = lay.s[w.list[top]], lay.a[w.list[top]]
    off = max(abs(theta[c, 0] - s0), abs(wrap(theta[c, 1] - a0, surface.period)))
    half = min(math.ceil(max(AROUND, off + COARSEST) / COARSEST), 12)
    side, n_cells, narrowest = COARSEST, 0, math.inf
    best = -math.inf
    for x in range(-half, half):
        for y in range(-half, half):
            s, a = s0 + (x + 0.5) * side, a0 + (y + 0.5) * side
            if n_cells < len(cell) and put_cell(lay, w, link, c, n, n_cells, s, a, side, theta[c, 2]):
                if cell[n_cells, 2] > best:
                    best, narrowest = cell[n_cells, 2], w.step[0]
                n_cells += 1
    first, last = 0, n_cells
    for _ in range(DIVISIONS):
        if side < FINE * narrowest or is_over(w):
            break
        side *= 0.5
        floor, best = best - NOTHING, -math.inf
        for o in range(first, last):
            if cell[o, 2] < floor or n_cells + 3 > len(cell):
                best = max(best, cell[o, 2])
                continue
            s, a, log_force = cell[o, 0], cell[o, 1], cell[o, 3]
            cell[o, 2] = -math.inf
            for child in range(4):
                at_s = s + (0.5 if child & 1 else -0.5) * side
                at_a = a + (0.5 if child & 2 else -0.5) * side
                if put_cell(lay, w, link, c, n, n_cells, at_s, at_a, side, log_force):
                    if cell[n_cells, 2] > best:
                        best, narrowest = cell[n_cells, 2], w.step[0]
                    n_cells += 1
        first, last = last, n_cells
    return n_cells, side


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
    log_force: float,
) -> bool:
    """Write the cell of this side (m) around (s, a) to row ``to``; return whether it is on the skin.

    Also writes to ``step[0]`` the standard deviation (m) in the direction in which its middle knows most.
    """
    if to >= len(w.cell):
        return False
    surface, felt = surface_of(lay.link, link), w.cell_felt
    home, nearest = -1, math.inf
    for t in range(n):
        i = w.list[t]
        d2, felt[t, 5], felt[t, 6] = separation(surface, s, a, lay.s[i], lay.a[i])
        felt[t, 3] = math.sqrt(d2)
        if d2 < nearest:
            home, nearest = i, d2
    place = w.rate
    place[0], place[1] = s, a
    if home < 0 or off_board(lay, link, lay.patch[home], place) > 0.0:
        return False
    w.work[DONE] += n
    fill_cell(lay, w, c, n, side)

    laws, lf, typical = lay.law_par, log_force, lay.law_par[lay.law[home], TYPICAL]
    if laws[lay.law[home], KIND] != CONE:
        # from a force far off, the variance that grows with it may lead further away
        top, bottom = 0.0, 0.0
        for t in range(n):
            if lay.law[w.list[t]] == lay.law[home]:
                top += felt[t, 0] * felt[t, 4]
                bottom += felt[t, 0] * felt[t, 0]
        if top > 0.0:
            lf = min(max(log_force_of(laws, lay.law[home], top / bottom), LOG_FORCE_MIN), LOG_FORCE_MAX)
    value, curvature, ss, sa, aa = 0.0, 0.0, 0.0, 0.0, 0.0
    for turn in range(FORCE_STEPS + 1):
        value, slope, curvature, ss, sa, aa = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if typical > 0.0:
            off = (lf - math.log(typical)) / FORCE_WIDTH
            value -= 0.5 * off * off
            slope -= off / FORCE_WIDTH
            curvature += 1.0 / (FORCE_WIDTH * FORCE_WIDTH)
        else:
            value += FORCE_PRIOR * lf
            slope += FORCE_PRIOR
        # logarithms are taken of products: one for many tactels
        variances, tails = 1.0, 1.0
        last, amp, damp = -1, 0.0, 0.0
        for t in range(n):
            i = w.list[t]
            law = lay.law[i]
            if law != last:
                amp, damp = amplitude(laws, law, lf)
                last = law
            p, p_f, scale = amp * felt[t, 0], damp * felt[t, 0], amp
            if laws[law, KIND] == CONE:
                # g = 1 and h = felt[0]: what it reads follows the amplitude, its slope does not
                p, p_f, scale = max(amp * felt[t, 7] + felt[t, 0], 0.0), damp * felt[t, 7], 1.0
                if p == 0.0:
                    p_f = scale = 0.0
            grows = amp * felt[t, 2]
            grows = grows * grows + scale * scale * felt[t, 1]
            variance = felt[t, 10] + grows
            residual = felt[t, 4] - p
            if w.state[i] == SATURATED:
                if residual <= 0.0:
                    continue
            else:
                variances *= variance / felt[t, 10]
                if variances > LARGE:
                    value -= 0.5 * math.log(variances)
                    variances = 1.0
                if laws[law, KIND] != CONE:
                    relative = 2.0 * laws[law, POWER] * grows / variance
                    slope += 0.5 * (residual * residual / variance - 1.0) * relative
                    curvature += 0.5 * relative * relative
            weight = 1.0 / variance
            if laws[law, PROFILED] != 0.0:
                q = residual * residual * weight
                tails *= 1.0 + q / (FREEDOM - 2.0)
                if tails > LARGE:
                    value -= 0.5 * (FREEDOM + 1.0) * math.log(tails)
                    tails = 1.0
                weight *= (FREEDOM + 1.0) / (FREEDOM - 2.0 + q)
            else:
                value -= 0.5 * residual * residual * weight
            slope += residual * p_f * weight
            curvature += p_f * p_f * weight
            known = scale * scale / (variance - scale * scale * felt[t, 1])
            ss += known * felt[t, 8] * felt[t, 8]
            sa += known * felt[t, 8] * felt[t, 9]
            aa += known * felt[t, 9] * felt[t, 9]
        value -= 0.5 * math.log(variances) + 0.5 * (FREEDOM + 1.0) * math.log(tails)
        if turn == FORCE_STEPS or not curvature > 0.0:
            break
        move = slope / curvature
        if abs(move) < 0.02 / math.sqrt(curvature):
            break  # the value here is within 2e-4 of the largest
        lf = min(max(lf + min(max(move, -1.5), 1.5), LOG_FORCE_MIN), LOG_FORCE_MAX)
    if not curvature > 0.0:
        return False
    sharpest = 0.5 * (ss + aa) + math.sqrt(0.25 * (ss - aa) * (ss - aa) + sa * sa)
    w.step[0] = 1.0 / math.sqrt(max(sharpest, 1e-300))
    cell = w.cell
    cell[to, 0], cell[to, 1] = s, a
    cell[to, 2] = value - 0.5 * math.log(curvature) + 2.0 * math.log(side)
    cell[to, 3], cell[to, 4] = lf, min(1.0 / curvature, 1.0)
    return True


@inner_kernel
def fill_cell(lay: Layout, w: Work, c: int, n: int, side: float) -> None:
    """Write to ``cell_felt`` what contact c in a cell makes tactels read, in parts free of its force.

    The variance across the cell is that of the law along the line to the tactel: a third of the square of
    half the difference of its ends, and the square of what they bend from the middle.
    """
    felt, laws, tables = w.cell_felt, lay.law_par, lay.law_table
    wide = w.theta[c, 3]
    narrow = 1.0 / wide
    spread = narrow * narrow
    for t in range(n):
        i = w.list[t]
        law, own, d = lay.law[i], lay.narrow[i] * narrow, felt[t, 3]
        felt[t, 2] = felt[t, 8] = felt[t, 9] = 0.0
        along = 1.0 / d if d > 0.0 else 0.0
        if laws[law, KIND] == CONE:
            slope = laws[law, SLOPE] * own * spread
            felt[t, 0], felt[t, 7] = -slope * d, spread
            felt[t, 1] = slope * slope * side * side / 12.0
            felt[t, 8], felt[t, 9] = -slope * felt[t, 5] * along, -slope * felt[t, 6] * along
            continue
        g, g_d = profile(laws, tables, law, d * own)
        before, _ = profile(laws, tables, law, abs(d - 0.5 * side) * own)
        after, _ = profile(laws, tables, law, (d + 0.5 * side) * own)
        half, bend = 0.5 * (before - after), 0.5 * (before + after) - g
        felt[t, 8], felt[t, 9] = g_d * own * felt[t, 5] * along, g_d * own * felt[t, 6] * along
        if lay.map_of[i] >= 0 and d * own < laws[law, STEP] * (laws[law, POINTS] - 1.0):
            r, r_s, r_a = residual_at(lay, i, felt[t, 5], felt[t, 6])
            g += r
            felt[t, 8] += r_s
            felt[t, 9] += r_a
        felt[t, 0] = spread * g
        felt[t, 1] = spread * spread * (half * half / 3.0 + bend * bend)
        felt[t, 8] *= spread
        felt[t, 9] *= spread
        if laws[law, PROFILED] != 0.0:
            felt[t, 2] = spread * misfit_at(laws, tables, law, d * narrow)


@inner_kernel
def summarise(w: Work, c: int, n_cells: int, period: float, side: float) -> bool:
    """Write mean and covariance of the cells to the columns of contact c; return whether they have mass."""
    cell, to = w.cell, w.members[c]
    best = -math.inf
    for o in range(n_cells):
        best = max(best, cell[o, 2])
    if not best > -math.inf:
        return False
    mass = s = a = force = 0.0
    s0, a0 = w.s[to], w.a[to]
    for o in range(n_cells):
        if cell[o, 2] < best - 2.0 * NOTHING:
            continue
        part = math.exp(cell[o, 2] - best)
        mass += part
        s += part * (cell[o, 0] - s0)
        a += part * wrap(cell[o, 1] - a0, period)
        force += part * math.exp(cell[o, 3] + 0.5 * cell[o, 4])
    s, a, force = s / mass, a / mass, force / mass
    ss = sa = aa = sf = af = ff = 0.0
    for o in range(n_cells):
        if cell[o, 2] < best - 2.0 * NOTHING:
            continue
        part = math.exp(cell[o, 2] - best) / mass
        x, y = cell[o, 0] - s0 - s, wrap(cell[o, 1] - a0, period) - a
        mean = math.exp(cell[o, 3] + 0.5 * cell[o, 4])
        f = mean - force
        ss += part * x * x
        sa += part * x * y
        aa += part * y * y
        sf += part * x * f
        af += part * y * f
        ff += part * (f * f + mean * mean * (math.exp(cell[o, 4]) - 1.0))
    within = side * side / 12.0
    # what the law leaves beyond its misfit was found at the fit: chi^2 there
    wider = max(w.wider_by[to], 1.0)
    w.covariance[to, 0, 0], w.covariance[to, 1, 1] = wider * (ss + within), wider * (aa + within)
    w.covariance[to, 0, 1] = w.covariance[to, 1, 0] = wider * sa
    w.covariance[to, 0, 2] = w.covariance[to, 2, 0] = wider * sf
    w.covariance[to, 1, 2] = w.covariance[to, 2, 1] = wider * af
    w.covariance[to, 2, 2] = wider * ff
    w.s[to], w.a[to], w.log_force[to] = s0 + s, wrap(a0 + a, period), math.log(force)
    return True
