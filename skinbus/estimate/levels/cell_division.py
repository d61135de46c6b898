"""The plane around a contact, divided into the cells of its posterior.

It is divided twice. First cells that may hold mass are divided into four, level by level, until they resolve
the likeliest mode in its narrowest direction. What is left undivided then has a mass that is too large: the
change of the pressures across a cell makes it likelier than the places in it are. That is one per cent of
the mass, but far off, and was most of the variance. So the cells that hold more than a part of the variance
of place or force are divided next, in rounds, until none does.

Failure: more cells than ``CELLS``, or than the rounds divide; coarser cells then stand for themselves, and
the variance is too large.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.disc_shapes import GAINS
from skinbus.estimate.kernels.geometry import surface_of, wrap
from skinbus.estimate.kernels.law import MISFIT, UNSIZED
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.estimate.levels.posterior_cell import COARSEST, WIDE_CELL, narrowest_way, put_cell
from skinbus.jit import inner_kernel

AROUND = 0.012
"""m, from the tactel that reads most: a contact further away would have another one nearest."""
DIVISIONS = 6
"""Most divisions of a cell before the rounds: down to 0.05 mm."""
FINE = 1.6
"""Standard deviations of the narrowest mode that a cell may measure: summed over a lattice so fine a normal
mode has its mass to 1e-3 and its variance to 2 per cent."""
NOTHING, LITTLE = 7.0, 4.0
"""Log mass below that of the best cell at which a cell is not divided at first: of a coarse one, which may
hide more than it shows, and of a small one."""
SETTLED = 0.01
"""Part of the variance of place or force that a cell may hold that is not divided: on arrays 8.75 and 9.9 mm
apart variances are then 1.1 to 1.3 times those of the integral, for 300 to 500 cells; with a third of it 1.1,
for twice the cells."""
ROUNDS = 6
"""Most rounds: four times what is divided is within 2 per cent of it."""
FAINTEST = 14.0
"""Log mass below that of the best cell at which a cell counts for nothing."""
AHEAD = 0.006
"""m: a place so much nearer to another tactel than to the one that reads most is none of the contact."""


@inner_kernel
def read_alone(lay: Layout, w: Work, c: int, n: int) -> tuple[int, float]:
    """Write to ``cell_felt`` what tactels read without the other contacts of ``theta``, and its variance.

    Returns which of the listed tactels that no other is nearer to reads most, -1 for none, and how much (Pa).
    """
    for t in range(n):
        i = w.list[t]
        w.cell_felt[t, 4] = w.p[i] - w.predicted[t]
        wrong = lay.law_par[lay.law[i], MISFIT] * w.p[i]
        if lay.law_par[lay.law[i], UNSIZED] != 0.0:
            wrong *= GAINS
        w.cell_felt[t, 8] = lay.sigma[i] * lay.sigma[i] + wrong * wrong + w.beside[t]
        w.cell_felt[t, 9] = 1.0 / w.cell_felt[t, 8]
    for m in range(w.n_felt[c]):
        w.cell_felt[w.felt_at[c, m], 4] += w.felt[c, m, 3]
    top, most = -1, 0.0
    for t in range(n):
        if w.owner[t] < 0 and w.cell_felt[t, 4] > most:
            top, most = t, w.cell_felt[t, 4]
    return top, most


@inner_kernel
def divide(lay: Layout, w: Work, link: int, c: int, n: int) -> tuple[int, float, int]:
    """Divide the plane around contact c of ``theta``, evaluated last, into cells; return how many.

    Also returns the deviation (m) of the likeliest mode in its narrowest direction, and which of the listed
    tactels reads most. Cells that were divided have no mass.
    """
    cell, theta = w.cell, w.theta
    surface = surface_of(lay.link, link)
    top, _ = read_alone(lay, w, c, n)
    if top < 0:
        return 0, 0.0, top
    s0, a0 = lay.s[w.list[top]], lay.a[w.list[top]]
    ahead = ahead_of(w, top)
    off = max(abs(theta[c, 0] - s0), abs(wrap(theta[c, 1] - a0, surface.period)))
    half = min(math.ceil(max(AROUND, off + COARSEST) / COARSEST), 12)
    side, n_cells, narrowest = COARSEST, 0, math.inf
    best = -math.inf
    for x in range(-half, half):
        if is_over(w):  # a part of the plane says nothing of the rest
            return 0, 0.0, top
        for y in range(-half, half):
            s, a = s0 + (x + 0.5) * side, a0 + (y + 0.5) * side
            if n_cells < len(cell) and put_cell(
                lay, w, link, c, n, n_cells, s, a, side, side, theta[c, 2], best, top, ahead
            ):
                if cell[n_cells, 2] > best:
                    best, narrowest = cell[n_cells, 2], narrowest_way(lay, w, n, cell[n_cells, 3])
                n_cells += 1
    first, last, resolved = 0, n_cells, False
    for _ in range(DIVISIONS):
        if resolved or is_over(w):
            break
        floor, best = best - (NOTHING if side >= WIDE_CELL else LITTLE), -math.inf
        side *= 0.5
        resolved = side < FINE * narrowest
        across = 0.0 if resolved else side
        for o in range(first, last):
            s, a, log_force = cell[o, 0], cell[o, 1], cell[o, 3]
            # the mode that is known is divided, however little of it a coarse cell shows
            known = abs(theta[c, 0] - s) <= side and abs(wrap(theta[c, 1] - a, surface.period)) <= side
            if (cell[o, 2] < floor and not known) or n_cells + 4 > len(cell):
                best = max(best, cell[o, 2])
                continue
            if known:
                log_force = theta[c, 2]
            n_cells, best, narrowest = divide_cell(
                lay, w, link, c, n, o, n_cells, across, log_force, best, narrowest, top
            )
        first, last = last, n_cells
    return n_cells, narrowest, top


@inner_kernel
def ahead_of(w: Work, top: int) -> float:
    """Return how much nearer to another tactel than to listed tactel ``top`` a place may be, m."""
    return math.inf if w.state[w.list[top]] == SATURATED else AHEAD


@inner_kernel
def divide_cell(
    lay: Layout,
    w: Work,
    link: int,
    c: int,
    n: int,
    o: int,
    n_cells: int,
    across: float,
    log_force: float,
    best: float,
    narrowest: float,
    top: int,
) -> tuple[int, float, float]:
    """Put four cells for cell o; return how many there are, the best log mass and the narrowest way there.

    ``across`` is that of :func:`put_cell`.
    """
    cell, ahead = w.cell, ahead_of(w, top)
    s, a, side = cell[o, 0], cell[o, 1], 0.5 * cell[o, 5]
    cell[o, 2] = -math.inf
    for child in range(4):
        at_s = s + (0.5 if child & 1 else -0.5) * side
        at_a = a + (0.5 if child & 2 else -0.5) * side
        if put_cell(lay, w, link, c, n, n_cells, at_s, at_a, side, across, log_force, best, top, ahead):
            if cell[n_cells, 2] > best:
                best, narrowest = cell[n_cells, 2], narrowest_way(lay, w, n, cell[n_cells, 3])
            n_cells += 1
    return n_cells, best, narrowest


@inner_kernel
def divide_by_variance(
    lay: Layout, w: Work, link: int, c: int, n: int, n_cells: int, narrowest: float, top: int
) -> int:
    """Divide the cells that hold more than ``SETTLED`` of the variance; return how many there are then."""
    cell, period = w.cell, surface_of(lay.link, link).period
    for _ in range(ROUNDS):
        best = -math.inf
        for o in range(n_cells):
            best = max(best, cell[o, 2])
        if not best > -math.inf:
            break
        mass = s = a = f = ss = ff = 0.0
        s0, a0, last = cell[0, 0], cell[0, 1], n_cells
        for o in range(last):
            if cell[o, 2] < best - FAINTEST:
                continue
            part = math.exp(cell[o, 2] - best)
            x, y, z = cell[o, 0] - s0, wrap(cell[o, 1] - a0, period), cell[o, 3]
            mass += part
            s += part * x
            a += part * y
            f += part * z
            ss += part * (x * x + y * y + cell[o, 5] * cell[o, 5] / 6.0)
            ff += part * (z * z + cell[o, 4])
        s, a, f = s / mass, a / mass, f / mass
        ss, ff = ss / mass - s * s - a * a, ff / mass - f * f
        for o in range(last):
            side = cell[o, 5]
            if side == 0.0 or cell[o, 2] < best - FAINTEST or n_cells + 4 > len(cell) or is_over(w):
                continue
            x, y, z = cell[o, 0] - s0 - s, wrap(cell[o, 1] - a0, period) - a, cell[o, 3] - f
            share = max((x * x + y * y + side * side / 6.0) / ss, z * z / ff)
            if math.exp(cell[o, 2] - best) * share > SETTLED * mass:
                across = 0.0 if 0.5 * side < FINE * narrowest else 0.5 * side
                n_cells, _, narrowest = divide_cell(
                    lay, w, link, c, n, o, n_cells, across, cell[o, 3], best, narrowest, top
                )
        if n_cells == last:
            break
    return n_cells


@inner_kernel
def coarseness(w: Work, n_cells: int) -> float:
    """Return the side (m) of the cell with the most mass where it does not resolve its mode, else 0."""
    best, side = -math.inf, 0.0
    for o in range(n_cells):
        if w.cell[o, 2] > best:
            best, side = w.cell[o, 2], w.cell[o, 5]
    return side
