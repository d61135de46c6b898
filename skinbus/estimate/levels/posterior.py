"""The posterior of a contact whose place the tactels determine badly, integrated over cells of the surface.

Between the tactels of a coarse array a contact is strong and far from one, or weak and near: its likelihood
has several modes, or one that bends, and no curvature describes it. Here the plane around the tactel that
reads most is divided into square cells. The mass of a cell is the likelihood at its middle, maximised over
the force, times the width of that maximum (Laplace) and the prior; the change of the pressures across the
cell is added to their variance, so that a mode narrower than a cell is not missed between two. Cells that
may hold mass or variance are divided (``cell_division``) until they resolve the mode; to the last nothing is
added, for the sum over a lattice that fine is the integral. The answer is the posterior mean, which has the
least expected squared error, and the covariance is that of all cells.

Contacts around are where they were fitted; what is not known of those in the same group adds to the variance
of the tactels that feel them.

Source: D. MacKay, Information Theory, Inference, and Learning Algorithms (2003), 27 (Laplace), 29.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.geometry import distance, surface_of, wrap
from skinbus.estimate.kernels.groups import add_background, is_near, list_tactels
from skinbus.estimate.kernels.law import PROFILED, UNSIZED, amplitude, misfit_at
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import evaluate
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.cell_division import (
    AROUND,
    FAINTEST,
    coarseness,
    divide,
    divide_by_variance,
    read_alone,
)
from skinbus.estimate.levels.contact_shape import AT_RIM, open_side
from skinbus.estimate.levels.posterior_cell import COARSEST, put_cell
from skinbus.estimate.levels.split_merge import clear_owners
from skinbus.jit import inner_kernel, runtime_int

REACHED, SKIRT = 3.0, 0.05
"""Standard deviations of its error, and part of the largest, that a tactel is pressed with which determines a
place."""
UNSURE = 0.25e-3
"""m, standard deviation of a place from which on it is integrated: a mode so long bends; shorter ones are
normal to a few per cent."""
FEW = 5
"""A contact that reaches fewer tactels is integrated, too: other places may explain them as well."""

WAY_OUT = (-3e-3, 0.0, 3e-3, 6e-3, 9e-3)
"""m, of the places on the way out from the tactel that reads most at which a contact at a rim may be."""
BARELY_OUTSIDE = -0.1
"""Cosine as those of ``contact_shape``: a place up to 2 mm beyond the outermost row is amid tactels."""
MAY_BE = 2e-3
"""m, standard deviation over those places from which on the contact is integrated."""
BROAD = 2e-3
"""m, standard deviation of a place at a rim from which on it stays the posterior mean; less, and the size of
what presses is estimated instead, as it is wherever the tactels determine it."""


@inner_kernel
def integrate_contacts(lay: Layout, w: Work, link: int, k: int, level: int) -> bool:
    """Write the posterior means and covariances of contacts just stored that are badly determined.

    Only where the law of the board has a misfit profile: it says what other places may explain. Under a law
    of any size this is for contacts at a rim: beyond it they are strong, and weak within. Above level ``fit``
    several under a law that was learned have their own ways.
    Returns whether there are such contacts: then other tactels are listed.
    """
    done = False
    for c in range(k):
        if is_over(w):
            break
        to = w.members[c]
        ss, sa, aa = w.covariance[to, 0, 0], w.covariance[to, 0, 1], w.covariance[to, 1, 1]
        longest = 0.5 * (ss + aa) + math.sqrt(0.25 * (ss - aa) * (ss - aa) + sa * sa)
        if (count_reached(w, c) >= FEW and longest < UNSURE * UNSURE) or w.nearest_tactel[c] < 0:
            continue
        law = lay.law[w.nearest_tactel[c]]
        if lay.law_par[law, PROFILED] == 0.0 and lay.law_par[law, UNSIZED] == 0.0:
            continue  # without a profile the law is held for true, and the mode that was found for the one
        if lay.law_par[law, PROFILED] != 0.0 and k > 1 and level > 1:
            continue
        if not done:
            n = list_tactels(lay, w, link, k, 0.0, AROUND + COARSEST, 0.0)
            add_background(lay, w, link, w.group[w.members[0]], k, n)
            clear_owners(w, n)
            evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
            done = True
        doubt_others(lay, w, link, c, k, n)
        if lay.law_par[law, PROFILED] == 0.0 and not is_open(lay, w, link, c, n):
            continue
        found = integrate(lay, w, link, c, n)
        w.averaged[to] = found
        w.integrated[to] = found and k == 1 and is_by_itself(w, n)
    return done


@inner_kernel
def is_open(lay: Layout, w: Work, link: int, c: int, n: int) -> bool:
    """Return whether contact c of ``theta``, evaluated last, may as well be beyond the rim of the tactels.

    Asked are places on the way out through the tactel that reads most.
    """
    top, _ = read_alone(lay, w, c, n)
    if top < 0:
        return False
    i, theta, cell, surface = w.list[top], w.theta, w.cell, surface_of(lay.link, link)
    out_s, out_a = open_side(lay, w, link, lay.s[i], lay.a[i], n, AT_RIM)
    if out_s == 0.0 and out_a == 0.0:
        return False
    along = out_s * (theta[c, 0] - lay.s[i]) + out_a * wrap(theta[c, 1] - lay.a[i], surface.period)
    best, n_cells = -math.inf, 0
    for turn in range(len(WAY_OUT)):
        s, a = theta[c, 0] + (WAY_OUT[turn] - along) * out_s, theta[c, 1] + (WAY_OUT[turn] - along) * out_a
        if put_cell(lay, w, link, c, n, n_cells, s, a, COARSEST, COARSEST, theta[c, 2], best, top, math.inf):
            best = max(best, cell[n_cells, 2])
            cell[n_cells, 3] = WAY_OUT[turn]
            n_cells += 1
    mass = first = second = 0.0
    for o in range(n_cells):
        part = math.exp(cell[o, 2] - best)
        mass += part
        first += part * (cell[o, 3] - along)
        second += part * (cell[o, 3] - along) ** 2
    return mass > 0.0 and second > MAY_BE * MAY_BE * mass


@inner_kernel
def count_reached(w: Work, c: int) -> int:
    """Return how many tactels determine the place of contact c of ``theta``, as evaluated last.

    On its skirts what the law leaves is as large as what it says: a place and its mirror image read alike.
    """
    reached, most = 0, 0.0
    for m in range(w.n_felt[c]):
        most = max(most, w.felt[c, m, 3])
    for m in range(w.n_felt[c]):
        p = w.felt[c, m, 3]
        if p > SKIRT * most and p * p * w.weight[w.felt_at[c, m]] > REACHED * REACHED:
            reached += 1
    return reached


@inner_kernel
def doubt_others(lay: Layout, w: Work, link: int, c: int, k: int, n: int) -> None:
    """Write to ``beside`` the variance of what contacts but c of ``theta`` press; own what is nearer to them.

    It is that of what their laws leave, and within the group of their covariances. Without it a strong answer
    far off is likely by what it may leave itself, where another contact is not quite as its law says.
    """
    clear_owners(w, n)
    surface, to = surface_of(lay.link, link), w.members[c]
    for t in range(n):
        i = w.list[t]
        w.beside[t] = 0.0
        w.cell_felt[t, 3] = distance(surface, w.s[to], w.a[to], lay.s[i], lay.a[i])
    for e in range(k):
        if e == c:
            continue
        p, f = w.covariance[w.members[e]], math.exp(-w.log_force[w.members[e]])
        for m in range(w.n_felt[e]):
            x, y, z = w.felt[e, m, 0], w.felt[e, m, 1], w.felt[e, m, 2] * f
            w.beside[w.felt_at[e, m]] += (
                x * x * p[0, 0]
                + y * y * p[1, 1]
                + z * z * p[2, 2]
                + 2.0 * (x * y * p[0, 1] + x * z * p[0, 2] + y * z * p[1, 2])
            )
        doubt_law(lay, w, link, w.members[e], n)
    top, bottom = -math.inf, math.inf
    for e in range(k):
        s, far = w.listed_theta[e, 0], w.far_listed[e] + w.span[0]
        top, bottom = max(top, s + far), min(bottom, s - far)
    for e in range(w.n_contacts[0]):
        if w.link[e] == link and bottom <= w.s[e] <= top and is_near(lay, w, link, w.group[to], k, e):
            doubt_law(lay, w, link, e, n)


@inner_kernel
def doubt_law(lay: Layout, w: Work, link: int, e: int, n: int) -> None:
    """Add to ``beside`` the variance of what the law of contact e leaves.

    It owns the tactels that are nearer to it than the distance in ``cell_felt``.
    """
    surface, s, a, narrow = surface_of(lay.link, link), w.s[e], w.a[e], 1.0 / w.width[e]
    laws, amp, last, is_doubted = lay.law_par, 0.0, -1, False
    for t in range(n):
        i = w.list[t]
        law, d = lay.law[i], distance(surface, s, a, lay.s[i], lay.a[i])
        w.owner[t] = e if d < w.cell_felt[t, 3] else w.owner[t]
        if law != last:
            amp, last = amplitude(laws, law, w.log_force[e])[0], law
            is_doubted = laws[law, PROFILED] + laws[law, UNSIZED] > 0.0
        if is_doubted:
            wrong = amp * misfit_at(laws, lay.law_table, law, d * narrow) * narrow * narrow
            w.beside[t] += wrong * wrong


@inner_kernel
def take_means(w: Work) -> None:
    """Replace place, force and covariance of contacts by their posterior means, once all are solved.

    Others are fitted beside the mode: beside a mean of near and far they would follow it.
    """
    for c in range(w.n_contacts[0]):
        if not w.averaged[c]:
            continue
        w.s[c], w.a[c], w.log_force[c] = w.mean[c, 0], w.mean[c, 1], w.mean[c, 2]
        for x in range(3):
            for y in range(3):
                w.covariance[c, x, y] = w.mean_covariance[c, x, y]


@inner_kernel
def is_by_itself(w: Work, n: int) -> bool:
    """Return whether no contact outside the group presses on the listed tactels."""
    alone = True
    for t in range(n):
        alone &= w.background[t] == 0.0
    return alone


@inner_kernel
def integrate(lay: Layout, w: Work, link: int, c: int, n: int) -> bool:
    """Write the posterior mean and covariance of contact c; return whether there is one."""
    n_cells, narrowest, top = divide(lay, w, link, c, n)
    is_learned = lay.law_par[lay.law[w.nearest_tactel[c]], PROFILED] != 0.0
    if is_learned:
        n_cells = divide_by_variance(lay, w, link, c, n, n_cells, narrowest, top)
    out_s, out_a = open_side(lay, w, link, w.theta[c, 0], w.theta[c, 1], n, BARELY_OUTSIDE)
    is_amid = is_learned and out_s == 0.0 and out_a == 0.0
    return n_cells > 0 and summarise(w, c, n_cells, surface_of(lay.link, link).period, is_amid)


@inner_kernel
def restart(lay: Layout, w: Work, link: int, c: int, n: int) -> bool:
    """Put contact c of ``theta``, evaluated last, to the middle of the cell with the most mass.

    It has the law's own width then. Returns whether there is such a cell.
    """
    theta, cell = w.theta, w.cell
    theta[c, 3] = 1.0
    for t in range(n):
        w.beside[t] = 0.0
    n_cells, _, _ = divide(lay, w, link, c, n)
    best = runtime_int(-1)
    for o in range(n_cells):
        if best < 0 or cell[o, 2] > cell[best, 2]:
            best = o
    if best < 0 or cell[best, 2] == -math.inf:
        return False
    theta[c, 0], theta[c, 1], theta[c, 2] = cell[best, 0], cell[best, 1], cell[best, 3]
    return True


@inner_kernel
def summarise(w: Work, c: int, n_cells: int, period: float, is_amid: bool) -> bool:
    """Write mean and second moments of the cells beside contact c; return whether they have mass.

    The force is the mean of its logarithm: its mean would be that of its largest values, however unlikely.
    Where the mode of a learned law is amid tactels it is the force with the least expected square of the
    relative error: 2 N said to be 20, as if far beyond a rim, are worse than 20 said to be 2.

    ``is_amid``: tactels are around the mode.
    """
    cell, to = w.cell, w.members[c]
    best = -math.inf
    for o in range(n_cells):
        best = max(best, cell[o, 2])
    if not best > -math.inf:
        return False
    mass = s = a = log_force = inverse = squared = 0.0
    s0, a0 = w.s[to], w.a[to]
    for o in range(n_cells):
        if cell[o, 2] < best - FAINTEST:
            continue
        part = math.exp(cell[o, 2] - best)
        mass += part
        s += part * (cell[o, 0] - s0)
        a += part * wrap(cell[o, 1] - a0, period)
        log_force += part * cell[o, 3]
        inverse += part * math.exp(0.5 * cell[o, 4] - cell[o, 3])
        squared += part * math.exp(2.0 * (cell[o, 4] - cell[o, 3]))
    s, a, force = s / mass, a / mass, math.exp(log_force / mass)
    if is_amid:
        force = inverse / squared
    ss = sa = aa = sf = af = ff = 0.0
    for o in range(n_cells):
        if cell[o, 2] < best - FAINTEST:
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
    side = coarseness(w, n_cells)
    within = side * side / 12.0
    if side > 0.0 and ss + aa < side * side and max(abs(s), abs(a)) < side:
        return False  # the one mode that was found, too narrow for cells: the fit describes it better
    # what the law leaves beyond its misfit was found at the fit: chi^2 there
    wider, cov = max(w.wider_by[to], 1.0), w.mean_covariance[to]
    cov[0, 0], cov[1, 1] = wider * (ss + within), wider * (aa + within)
    cov[0, 1] = cov[1, 0] = wider * sa
    cov[0, 2] = cov[2, 0] = wider * sf
    cov[1, 2] = cov[2, 1] = wider * af
    cov[2, 2] = wider * ff
    w.mean[to, 0], w.mean[to, 1], w.mean[to, 2] = s0 + s, wrap(a0 + a, period), math.log(force)
    return True
