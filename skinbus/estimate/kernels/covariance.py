"""What is known of an answer: the covariance of its parameters on the mode of the likelihood that it is on.

The inverse of the Fisher information J'WJ, with a wide normal prior added, so that what no tactel determines
is reported as unknown instead of being infinite; and stretched where the mode is flatter than its top.

Assumption: one mode; ``levels/modes`` joins several. Failure: ridges that bend.
Source: S. Kay, Fundamentals of Statistical Signal Processing I (1993), 3.9 (Fisher information).
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.least_squares import evaluate, factorise
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.split_merge import clear_owners, copy_rows
from skinbus.jit import inner_kernel

PRIOR_PLACE = 0.025
"""m, half a board: a contact is somewhere on the patch that feels it."""
PRIOR_LOG_FORCE = 2.0
"""A factor of 7 either way."""
MODE_PLACE, MODE_LOG_FORCE = 1e-3, 0.25
"""m; a mode is taken to be no wider than this when modes are weighed, however flat its top: a contact that
moves further has other tactels near."""
WAY = (-6.0, -3.0, -1.5, 1.5, 3.0, 6.0)
"""Standard deviations from the top at which a mode is compared with a normal one."""


@inner_kernel
def add_prior(w: Work, k: int) -> None:
    """Add the prior of k contacts to the information in ``normal``."""
    add_normal_prior(w, k, PRIOR_PLACE, PRIOR_LOG_FORCE)


@inner_kernel
def add_normal_prior(w: Work, k: int, place: float, log_force: float) -> None:
    """Add a normal prior with these standard deviations (m, 1) to the information in ``normal``."""
    normal = w.normal
    for c in range(k):
        u = 3 * c
        normal[u, u] += 1.0 / (place * place)
        normal[u + 1, u + 1] += 1.0 / (place * place)
        normal[u + 2, u + 2] += 1.0 / (log_force * log_force)


@inner_kernel
def information(lay: Layout, w: Work, link: int, k: int, n: int, theta: Floats) -> float:
    """Write the covariance of ``theta`` on its own mode to ``inverse``; return chi^2."""
    clear_owners(w, n)
    chi2, _, _ = evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
    add_prior(w, k)
    invert(w, 3 * k)
    return chi2


@inner_kernel
def invert(w: Work, m: int) -> None:
    """Write the inverse of the normal matrix, which the prior has made definite, to ``inverse``."""
    factor, pivot, inverse = w.factor, w.pivot, w.inverse
    damping = 0.0
    while not factorise(w, w.normal, m, damping):
        damping = max(10.0 * damping, 1e-13)
    for v in range(m):
        # column v of L^-1 below the diagonal, on the upper triangle of ``inverse``
        inverse[v, v] = 1.0
        for u in range(v + 1, m):
            x = 0.0
            for t in range(v, u):
                x -= factor[u, t] * inverse[v, t]
            inverse[v, u] = x
    for u in range(m):
        for v in range(u + 1):
            # (L^-T D^-1 L^-1)[u, v]; the upper triangle of ``inverse`` is read before it is overwritten
            x = 0.0
            for t in range(u, m):
                x += inverse[u, t] * pivot[t] * inverse[v, t]
            factor[u, v] = x
    for u in range(m):
        for v in range(u + 1):
            inverse[u, v] = factor[u, v]
            inverse[v, u] = factor[u, v]


@inner_kernel
def stretch(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Stretch the covariances of the answer where its mode is flatter than its top.

    Along the way on which one parameter leaves the top and the others follow it best, chi^2 rises by t^2 at t
    standard deviations if the mode is normal. Where it rises less, that parameter is less sure: its variance
    is that of exp(-chi^2 / 2) on the way.
    """
    theta, covariance, members = w.theta, w.covariance, w.members
    top = information(lay, w, link, k, n, theta)
    for c in range(k):
        if w.wider[3 * c] == 0.0:
            continue
        for x in range(3):
            j = 3 * c + x
            sd = math.sqrt(w.inverse[j, j])
            mass, spread, normal_mass, normal_spread = 1.0, 0.0, 1.0, 0.0
            if sd > (MODE_LOG_FORCE if x == 2 else MODE_PLACE):
                continue
            for turn in range(len(WAY)):
                if is_over(w):
                    return
                t = WAY[turn]
                copy_rows(theta, w.before, k)
                for e in range(k):
                    for y in range(3):
                        w.before[e, y] += t * w.inverse[3 * e + y, j] / sd
                chi2, _, _ = evaluate(lay, w, link, w.before, k, n, w.normal, w.gradient)
                weight = math.exp(-0.5 * max(chi2 - top, 0.0))
                mass += weight
                spread += weight * t * t
                weight = math.exp(-0.5 * t * t)
                normal_mass += weight
                normal_spread += weight * t * t
            w.wider[j] = math.sqrt(max(spread / mass / (normal_spread / normal_mass), 1.0))
    for c in range(k):
        if w.wider[3 * c] == 0.0:
            continue
        to = members[c]
        for x in range(3):
            for y in range(3):
                covariance[to, x, y] *= w.wider[3 * c + x] * w.wider[3 * c + y]
