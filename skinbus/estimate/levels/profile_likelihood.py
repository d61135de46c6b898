"""Covariance along a ridge: a long mode of the likelihood bends, and its top says little of its ends.

The place of a contact that few tactels feel, or of one close to another, is badly known in one direction, and
on the way in that direction the force, the other coordinate and the contacts around follow on a curve. A
tactel at the very edge of a contact makes it worse: on one side of the edge it says nothing, so that the top
of the mode looks sharp and is not. From the top the ridge is walked both ways, each step a prediction by the
information of where it is and a fit of all else with the way held (continuation). The covariance is::

    P = sum_i m_i (P_i + (x_i - x)(x_i - x)') / sum_i m_i,    m_i ~ exp(-chi^2_i / 2) |A_i|^(-1/2) / F dt

over points x_i of the ridge, t the way; P_i and A_i are covariance and information across it, the prior is
that of ``rivals``. The edge of the skin ends a ridge.

Assumption: across the ridge the mode is normal. Failure: ridges that fork, turn back or close to a ring.
Source: E. Allgower, K. Georg, Numerical Continuation Methods (1990), 2.2; L. Tierney, J. Kadane, Accurate
approximations for posterior moments and marginal densities (1986), for the integral.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.constants import BAD_FIT, FORCE_PRIOR, NOT_CONVERGED
from skinbus.estimate.kernels.covariance import add_prior, invert
from skinbus.estimate.kernels.geometry import surface_of, wrap
from skinbus.estimate.kernels.law import UNSIZED
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import evaluate, factorise, solve_step
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.split_merge import clear_owners, copy_rows
from skinbus.jit import inner_kernel

FAINT = 3.0
"""Standard deviations of a reading, below which a tactel is hardly pressed."""
FEWEST = 2
"""Tactels that make a ridge; around one there is a ring."""
LONG = 0.12e-3
"""m, standard deviation of a place from which on its mode is taken for a ridge; shorter ones are straight."""
LONG_SIZED = 0.5e-3
"""m, the same where sizes are estimated afterwards: with them goes a covariance of their own, and only what
is much wider than that is kept."""
STRIDE, LONGEST_STRIDE = 1.0, 2e-3
"""Of the standard deviation where the ridge is; m."""
STEEPEST = 2.0
"""Standard deviations; a stride that goes down further is halved."""
STEPS = 14
CORRECTIONS = 3
END = 18.0
"""chi^2 above the top at which nothing of the mass is left."""
HELD = 1e6
"""Information on the held way, relative to that at the top."""


@inner_kernel
def walk_ridges(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Write the covariances of the contacts of ``theta`` whose modes are ridges.

    ``wider`` is 0 for them, and for those whose covariance is written later, with that of their size.
    """
    members, moment = w.members, w.moment
    for u in range(3 * k):
        w.wider[u] = 1.0
    for c in range(k):
        if is_over(w):
            return
        to = members[c]
        if w.quality[to] & (NOT_CONVERGED | BAD_FIT) or w.n_tactels[to] < FEWEST:
            continue
        length, ds, da = way_of(lay, w, link, k, n, c)
        home = w.nearest_tactel[c]
        is_sized = home >= 0 and lay.law_par[lay.law[home], UNSIZED] != 0.0
        if not length > (LONG_SIZED if is_sized else LONG):
            w.wider[3 * c] = 0.0 if is_sized else 1.0
            continue
        mass = 0.0
        for x in range(3):
            for y in range(3):
                moment[2, x, y] = 0.0
        for side in range(2):
            mass += walk(lay, w, link, k, n, c, ds, da, -1.0 if side else 1.0)
        if not mass > 0.0 or is_over(w):
            continue
        for x in range(3):
            for y in range(3):
                w.covariance[to, x, y] = moment[2, x, y] / mass
        w.wider[3 * c] = 0.0


@inner_kernel
def way_of(lay: Layout, w: Work, link: int, k: int, n: int, c: int) -> tuple[float, float, float]:
    """Return how far (m) the place of contact c is unknown where it is known least, and where: a unit vector.

    Tactels that it hardly presses are not asked: on one side of their edge they know nothing.
    """
    inverse, weight, rest = w.inverse, w.weight, w.base
    clear_owners(w, n)
    evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
    for t in range(n):
        rest[t] = weight[t]
        if w.predicted[t] - w.background[t] < FAINT * lay.sigma[w.list[t]]:
            weight[t] = 0.0
    evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
    for t in range(n):
        weight[t] = rest[t]
    add_prior(w, k)
    invert(w, 3 * k)
    u = 3 * c
    ss, sa, aa = inverse[u, u], inverse[u, u + 1], inverse[u + 1, u + 1]
    angle = 0.5 * math.atan2(2.0 * sa, ss - aa)
    ds, da = math.cos(angle), math.sin(angle)
    return math.sqrt(ds * ds * ss + 2.0 * ds * da * sa + da * da * aa), ds, da


@inner_kernel
def walk(lay: Layout, w: Work, link: int, k: int, n: int, c: int, ds: float, da: float, side: float) -> float:
    """Walk one side of the ridge of contact c; add its moments to ``moment[2]``; return its mass."""
    theta, at, trial, normal, gradient = w.theta, w.before, w.wide, w.normal, w.gradient
    step, inverse, moment = w.step, w.inverse, w.moment
    period = surface_of(lay.link, link).period
    u, m = 3 * c, 3 * k
    copy_rows(theta, at, k)
    last = w.path
    mass, way, before, held, first, top = 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    risen, most = 0.0, LONGEST_STRIDE
    for turn in range(STEPS):
        if is_over(w):
            break
        chi2, _, _ = evaluate(lay, w, link, at, k, n, normal, gradient)
        add_prior(w, k)
        invert(w, m)
        variance = (
            ds * ds * inverse[u, u] + 2.0 * ds * da * inverse[u, u + 1] + da * da * inverse[u + 1, u + 1]
        )
        stride = side * min(STRIDE * math.sqrt(variance), most)
        copy_rows(at, last, k)
        for e in range(k):
            for y in range(3):
                v = 3 * e + y
                trial[e, y] = at[e, y] + stride * (inverse[v, u] * ds + inverse[v, u + 1] * da) / variance
            trial[e, 2] = min(max(trial[e, 2], at[e, 2] - 1.0), at[e, 2] + 1.0)
            trial[e, 3] = at[e, 3]
        if turn == 0:
            held, top = HELD / variance, chi2
            first = slice_of(lay, w, link, k, c, ds, da, held, 0.0, 0)
        chi2, off_by = math.inf, 0.0
        for correction in range(CORRECTIONS + 1):
            chi2_trial, _, off_by_trial = evaluate(lay, w, link, trial, k, n, normal, gradient)
            if not chi2_trial < chi2:
                # one too many: back to the last, for its information
                chi2, _, off_by = evaluate(lay, w, link, at, k, n, normal, gradient)
                break
            gone = chi2 - chi2_trial
            chi2, off_by = chi2_trial, off_by_trial
            copy_rows(trial, at, k)
            if correction == CORRECTIONS or gone < 0.05 or is_over(w):
                break
            hold(w, u, ds, da, held)
            damping = 1e-6
            while not factorise(w, normal, m, damping):
                damping = 10.0 * damping
            solve_step(w, gradient, m)
            for e in range(k):
                for y in range(3):
                    trial[e, y] = at[e, y] + step[3 * e + y]
                trial[e, 2] = min(max(trial[e, 2], at[e, 2] - 1.0), at[e, 2] + 1.0)
        rise = math.sqrt(max(chi2 - top, 0.0))
        if rise - risen > STEEPEST:
            most = 0.5 * abs(stride)
            copy_rows(last, at, k)
            continue
        if off_by > 0.0:
            break
        moved = ds * (at[c, 0] - theta[c, 0]) + da * wrap(at[c, 1] - theta[c, 1], period)
        stride = abs(moved) - way
        if not stride > 0.0:
            break
        risen, most = rise, min(2.0 * stride, LONGEST_STRIDE)
        way += stride
        after = slice_of(lay, w, link, k, c, ds, da, held, chi2 - top, 1) - first
        after = math.exp(min(after, 3.0))
        mass += 0.5 * stride * (before + after)
        for x in range(3):
            for y in range(3):
                moment[2, x, y] += 0.5 * stride * (before * moment[0, x, y] + after * moment[1, x, y])
                moment[0, x, y] = moment[1, x, y]
        before = after
        if chi2 - top > END:
            break
    return mass


@inner_kernel
def hold(w: Work, u: int, ds: float, da: float, held: float) -> None:
    """Add the information that holds the way of the contact at row u to ``normal``."""
    w.normal[u, u] += held * ds * ds
    w.normal[u + 1, u + 1] += held * da * da
    w.normal[u + 1, u] += held * ds * da


@inner_kernel
def slice_of(
    lay: Layout, w: Work, link: int, k: int, c: int, ds: float, da: float, held: float, worse: float, to: int
) -> float:
    """Write the moments of the slice at ``before`` to ``moment[to]``, about the top; return its log mass."""
    theta, at, inverse, moment = w.theta, w.before, w.inverse, w.moment
    u = 3 * c
    add_prior(w, k)
    hold(w, u, ds, da, held)
    invert(w, 3 * k)
    density = -0.5 * max(worse, 0.0)
    for e in range(k):
        density += FORCE_PRIOR * at[e, 2]
    density += 0.5 * log_determinant(w, 3 * k)
    force, best = math.exp(at[c, 2]), math.exp(theta[c, 2])
    off = w.step
    off[0] = at[c, 0] - theta[c, 0]
    off[1] = wrap(at[c, 1] - theta[c, 1], surface_of(lay.link, link).period)
    off[2] = force - best
    for x in range(3):
        for y in range(3):
            p = inverse[u + x, u + y] * (force if x == 2 else 1.0) * (force if y == 2 else 1.0)
            moment[to, x, y] = p + off[x] * off[y]
    return density


@inner_kernel
def log_determinant(w: Work, m: int) -> float:
    """Return the logarithm of the determinant of the inverse of ``normal``."""
    damping = 0.0
    while not factorise(w, w.normal, m, damping):
        damping = max(10.0 * damping, 1e-13)
    total = 0.0
    for v in range(m):
        total += math.log(w.pivot[v])
    return total
