"""The posterior of a contact whose width the tactels determine badly, integrated over the width.

Where what presses has a size that nobody has measured, place and force depend on the width, and amid four
tactels of a coarse array the force first rises and then falls with it: no curvature describes that. From
the answer the width goes up and down in steps, all else following by Gauss-Newton steps with it held. Mean
and covariance are::

    x = sum_i m_i x_i,    P = sum_i m_i (P_i + (x_i - x)(x_i - x)'),    m_i ~ exp(-chi^2_i / 2) |A_i|^(-1/2)

P_i and A_i are covariance and information with the width held, chi^2 has the prior of the width in it.

Assumption: with the width held, the likelihood has one mode and is normal.
Source: L. Tierney, J. Kadane, Accurate approximations for posterior moments and marginal densities (1986).
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.constants import FEW_TACTELS, MAX_MOVE
from skinbus.estimate.kernels.covariance import add_prior, invert
from skinbus.estimate.kernels.geometry import surface_of, wrap
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import MAX_LOG_STEP, copy_rows, factorise, solve_step
from skinbus.estimate.kernels.normal_equations import (
    NARROWEST,
    evaluate,
    has_widths,
    is_sized,
    n_unknowns,
    widest,
)
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.split_merge import clear_owners
from skinbus.jit import inner_kernel

UNSURE = 0.05
"""Standard deviation of a log width from which on it is integrated over: shorter posteriors are straight."""
STRIDE, LONGEST = 1.25, 0.1
"""Of that standard deviation, and of log width: sums over a lattice that fine have the moments of a normal
posterior to 1 %."""
STEPS = 6
"""On either side."""
CORRECTIONS = 2
END = 12.0
"""chi^2 above the answer's at which nothing of the mass is left."""
HELD = 1e6
"""Information on the held width, relative to its own."""


@inner_kernel
def integrate_widths(lay: Layout, w: Work, link: int, k: int, n: int, level: int) -> bool:
    """Replace place, force and covariance of contacts just stored of badly known width; return if any.

    At the level above ``fit`` this is for a contact alone; those of several have their own ways there.
    """
    done = False
    if not has_widths(lay, w) or (k > 1 and level > 1):
        return done
    for c in range(k):
        to = w.members[c]
        if w.quality[to] & FEW_TACTELS or not w.width_sd[to] > UNSURE * w.width[to]:
            continue  # what fewer than three tactels leave open is no matter of width
        if is_over(w):
            break
        done = True
        integrate_width(lay, w, link, k, n, c)
    return done


@inner_kernel
def integrate_width(lay: Layout, w: Work, link: int, k: int, n: int, c: int) -> None:
    """Write the posterior mean and covariance of contact c of ``theta`` over its width to its columns."""
    to, at, period = w.members[c], w.before, surface_of(lay.link, link).period
    first, second = w.moment[0], w.moment[1]
    stride = min(STRIDE * w.width_sd[to] / w.width[to], LONGEST)
    mass, top, level = 0.0, 0.0, 0.0
    for x in range(3):
        first[0, x] = 0.0
        for y in range(3):
            second[x, y] = 0.0
    clear_owners(w, n)
    for side in range(2):
        copy_rows(w.theta, at, k)
        for step in range(STEPS + 1):
            if is_over(w):
                return
            if step == 0 and side == 1:
                continue  # the answer itself has been counted
            if step > 0:
                at[c, 3] *= math.exp(-stride if side else stride)
                if not NARROWEST <= at[c, 3] <= widest(k):
                    break
                follow(lay, w, link, k, n, c)
            chi2, _, off_by = evaluate(lay, w, link, at, k, n, w.normal, w.gradient)
            if off_by > 0.0 or (step > 0 and chi2 > top + END):
                break
            hold_width(w, k, c)
            add_prior(w, k)
            m = n_unknowns(lay, w, k)
            invert(w, m)
            density = 0.0
            for u in range(m):
                density += 0.5 * math.log(w.pivot[u])
            if step == 0:
                top, level = chi2, density
            part = math.exp(min(0.5 * (top - chi2) + density - level, 6.0))
            force = math.exp(at[c, 2])
            off = w.step
            off[0] = at[c, 0] - w.theta[c, 0]
            off[1] = wrap(at[c, 1] - w.theta[c, 1], period)
            off[2] = force - math.exp(w.theta[c, 2])
            mass += part
            for x in range(3):
                first[0, x] += part * off[x]
                for y in range(3):
                    p = w.inverse[3 * c + x, 3 * c + y]
                    p *= (force if x == 2 else 1.0) * (force if y == 2 else 1.0)
                    second[x, y] += part * (p + off[x] * off[y])
    if not mass > 0.0:
        return
    wider = max(w.wider_by[to], 1.0)
    for x in range(3):
        for y in range(3):
            p = second[x, y] / mass - first[0, x] * first[0, y] / (mass * mass)
            w.covariance[to, x, y] = wider * p
    w.s[to] = w.theta[c, 0] + first[0, 0] / mass
    w.a[to] = wrap(w.theta[c, 1] + first[0, 1] / mass, period)
    w.log_force[to] = math.log(max(math.exp(w.theta[c, 2]) + first[0, 2] / mass, 1e-20))


@inner_kernel
def follow(lay: Layout, w: Work, link: int, k: int, n: int, c: int) -> None:
    """Bring ``before`` to the best place and force of all contacts with the width of contact c held."""
    at, step = w.before, w.step
    m = n_unknowns(lay, w, k)
    for _ in range(CORRECTIONS):
        evaluate(lay, w, link, at, k, n, w.normal, w.gradient)
        hold_width(w, k, c)
        damping = 1e-6
        while not factorise(w, w.normal, m, damping):
            damping = 10.0 * damping
        solve_step(w, w.gradient, m)
        for e in range(k):
            shrink = min(1.0, MAX_LOG_STEP / max(abs(step[3 * e + 2]), 1e-300))
            for x in range(2):
                shrink = min(shrink, MAX_MOVE / max(abs(step[3 * e + x]), 1e-300))
            for x in range(3):
                at[e, x] += shrink * step[3 * e + x]
            if e != c and not is_sized(lay, w, e):
                width = at[e, 3] * math.exp(shrink * step[3 * k + e])
                at[e, 3] = min(max(width, NARROWEST), widest(k))


@inner_kernel
def hold_width(w: Work, k: int, c: int) -> None:
    """Add the information that holds the width of contact c to ``normal``."""
    row = 3 * k + c
    w.normal[row, row] *= HELD
