"""Damped least squares of the model of a group: the most probable contacts near a start, and their evidence.

::

    minimise  chi^2(theta) + sum_k [((log F_k - f) / sd_f)^2 + ((u_k - u) / sd_u)^2]

``evidence`` has the formula of the log evidence.

Steps are those of Levenberg and Marquardt. Damping is in proportion to the diagonal of the normal matrix, so
units do not matter. A step is at most a pitch, a factor e of the force and half a unit of u. Places stay on
the board of the nearest listed tactel.

Failure: a local minimum. The moves therefore start from other places, too.

Source: J. Nocedal, S. Wright, Numerical Optimization (2006), 10.3.
"""

from __future__ import annotations

import math

from skinbus.arrays import Floats
from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.board_places import keep_on_board
from skinbus.estimate.kernels.disc_shapes import OWN_SIZES, SPREADS
from skinbus.estimate.kernels.law import amplitude, core
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.workspace import Search, Work
from skinbus.estimate.levels.merge import LOG_FORCE_MAX, LOG_FORCE_MIN
from skinbus.estimate.search.model import predict, write_normal
from skinbus.jit import inner_kernel

CONVERGED, ITERATION_LIMIT = 0, 1
"""Status of a fit."""
PLACE_SD = 0.025
"""m, standard deviation of the prior of a place: half a board."""
CONTACT_ODDS = -6.0
"""Log prior odds of one contact more."""
ITERATIONS = 30
"""Steps of a fit: half of all end after two, nine in ten after at most 17."""
ROUGH, SETTLED = 0.05, 1e-4
"""A step that promises to decrease chi^2 by less is the last, and nothing is evaluated after it: for a
hypothesis (such a step is a fifth of a standard deviation), for the answer."""
HOPE = 4.0
"""A fit is expected to decrease chi^2 in all by at most so many times what its next step promises."""
FIRST_DAMPING, LAST_DAMPING = 1e-3, 1e4
"""In units of the diagonal: the first step is nearly that of Gauss and Newton; beyond the last, steps are so
short that the fit ends."""
NEGLIGIBLE, KINK = 1e-4, 1e-2
"""A step that decreases chi^2 by less than the first, at a damping above the second, ends a fit: at a kink of
the law or a bound of u, steps go to and fro."""
SINGULAR = 1e-14
"""Share of the diagonal that a pivot must keep: less is rounding, and the matrix is singular."""


@inner_kernel
def evaluate(lay: Layout, w: Work, q: Search, link: int, theta: Floats, k: int) -> float:
    """Return the objective of k contacts; write the Jacobian."""
    value = predict(lay, w, q, link, theta, k)
    for c in range(k):
        off = (theta[c, 2] - q.force_prior[0]) / q.force_prior[1]
        value += off * off
        if q.dof[0] == 4:
            off = (theta[c, 3] - q.kind_mean[q.kind[c]]) / SPREADS[q.kind[c]]
            value += off * off
    return value


@inner_kernel
def write_equations(lay: Layout, w: Work, q: Search, k: int) -> None:
    """Write normal matrix and gradient of the first k contacts of ``theta``, evaluated last, with priors.

    The prior of a place is uniform, so the gradient has no part of it. In the matrix it bounds the
    uncertainty of the place, and with it the volume of Laplace's approximation, by the core of the contact:
    beyond, the tactels would feel it less. The bound is at least a pitch and at most ``PLACE_SD``.
    """
    write_normal(lay, w, q, k)
    dof, normal, gradient, law = q.dof[0], q.normal, q.gradient, lay.law[q.listed[0]]
    for c in range(k):
        theta = q.theta[c]
        u, sd = dof * c, q.force_prior[1]
        away = min(
            PLACE_SD, max(q.pitch[0], core(lay.law_par, law, amplitude(lay.law_par, law, theta[2])[0]))
        )
        normal[u, u] += 1.0 / (away * away)
        normal[u + 1, u + 1] += 1.0 / (away * away)
        normal[u + 2, u + 2] += 1.0 / (sd * sd)
        gradient[u + 2] -= (theta[2] - q.force_prior[0]) / (sd * sd)
        if dof == 4:
            kind = q.kind[c]
            sd = SPREADS[kind]
            normal[u + 3, u + 3] += 1.0 / (sd * sd)
            gradient[u + 3] -= (theta[3] - q.kind_mean[kind]) / (sd * sd)


@inner_kernel
def log_evidence(q: Search, k: int, value: float) -> float:
    """Return the log evidence of k contacts from their objective and the matrix factorised last."""
    dof, total = q.dof[0], -0.5 * value
    for u in range(dof * k):
        total -= math.log(q.factor[u, u])
    total += k * (CONTACT_ODDS - 2.0 * math.log(PLACE_SD) - math.log(q.force_prior[1]))
    for c in range(k):
        total -= max(q.theta[c, 2] - q.force_prior[0], 0.0)
    for c in range(k if dof == 4 else 0):
        total += math.log(q.kind_share[q.kind[c]] / SPREADS[q.kind[c]])
    return float(total)


@inner_kernel
def factorise(q: Search, m: int, damping: float) -> bool:
    """Write the Cholesky factor of the damped normal matrix; return whether there is one."""
    normal, factor = q.normal, q.factor
    for u in range(m):
        for v in range(u + 1):
            x = normal[u, v]
            for t in range(v):
                x -= factor[u, t] * factor[v, t]
            if u > v:
                factor[u, v] = x / factor[v, v]
            else:
                x += damping * normal[u, u]
                if not x > SINGULAR * normal[u, u]:
                    return False
                factor[u, u] = math.sqrt(x)
    return True


@inner_kernel
def solve(q: Search, m: int, right: Floats, to: Floats) -> None:
    """Write the solution of factor factor' to = right."""
    factor = q.factor
    for u in range(m):
        x = right[u]
        for t in range(u):
            x -= factor[u, t] * to[t]
        to[u] = x / factor[u, u]
    for u in range(m - 1, -1, -1):
        x = to[u]
        for t in range(u + 1, m):
            x -= factor[t, u] * to[t]
        to[u] = x / factor[u, u]


@inner_kernel
def invert(q: Search, m: int) -> None:
    """Write the inverse of the matrix factorised last."""
    for u in range(m):
        for v in range(m):
            q.scratch[v] = 1.0 if v == u else 0.0
        solve(q, m, q.scratch, q.inverse[u])


@inner_kernel
def linearise(lay: Layout, w: Work, q: Search, link: int, k: int) -> float:
    """Return the objective of the first k contacts of ``theta``; write Jacobian and normal equations."""
    value = evaluate(lay, w, q, link, q.theta, k)
    write_equations(lay, w, q, k)
    return value


@inner_kernel
def fit(lay: Layout, w: Work, q: Search, link: int, k: int, enough: float, bar: float) -> tuple[float, int]:
    """Fit the first k contacts of ``theta``; return the objective and a status.

    A step that promises less than ``enough`` is the last; Jacobian, residuals and normal equations are those
    before it. The objective is infinity if the fit is given up: where the log evidence would be below ``bar``
    even if the objective fell by ``HOPE`` times what the next step promises.
    """
    dof, theta, trial, step = q.dof[0], q.theta, q.trial, q.step
    m, damping, status, is_stale, at_kink = dof * k, FIRST_DAMPING, ITERATION_LIMIT, False, False
    value = linearise(lay, w, q, link, k)
    for _ in range(ITERATIONS if value < math.inf else 0):
        if at_kink or damping > LAST_DAMPING:
            status = CONVERGED
        if status == CONVERGED or is_over(w):
            break
        while not factorise(q, m, damping):
            damping = max(10.0 * damping, 1e-6)
            if not damping <= LAST_DAMPING:
                return math.inf, status
        solve(q, m, q.gradient, step)
        promised = 0.0
        for u in range(m):
            promised += step[u] * q.gradient[u]
        if log_evidence(q, k, value - HOPE * promised) < bar:
            return math.inf, status
        if promised < enough:
            status = CONVERGED
        for c in range(k):
            u = dof * c
            move = math.sqrt(step[u] ** 2 + step[u + 1] ** 2)
            longest = max(1.0, move / q.pitch[0], abs(step[u + 2]))
            trial[c, 3] = theta[c, 3]
            if dof == 4:
                longest = max(longest, 2.0 * abs(step[u + 3]))
                trial[c, 3] = min(max(theta[c, 3] + step[u + 3] / longest, OWN_SIZES[0]), OWN_SIZES[1])
            trial[c, 0] = theta[c, 0] + step[u] / longest
            trial[c, 1] = theta[c, 1] + step[u + 1] / longest
            trial[c, 2] = min(max(theta[c, 2] + step[u + 2] / longest, LOG_FORCE_MIN), LOG_FORCE_MAX)
            keep_on_board(lay, link, q.listed, q.n_listed[0], trial[c])
        if status == CONVERGED:  # the last step changes nothing that has to be evaluated again
            copy_contacts(trial, theta, k)
            value -= promised
            break
        new = evaluate(lay, w, q, link, trial, k)
        is_stale = not new <= value  # Jacobian and residuals are of a step not taken
        at_kink = not is_stale and value - new < NEGLIGIBLE and damping > KINK
        damping = 10.0 * damping if is_stale else max(0.1 * damping, 1e-9)
        if not is_stale:
            value = new
            copy_contacts(trial, theta, k)
            write_equations(lay, w, q, k)
    if is_stale:
        linearise(lay, w, q, link, k)
    return value, status


@inner_kernel
def copy_contact(source: Floats, to: Floats) -> None:
    """Copy place, log force and size of a contact."""
    for x in range(4):
        to[x] = source[x]


@inner_kernel
def copy_contacts(source: Floats, to: Floats, k: int) -> None:
    """Copy k rows of contacts."""
    for c in range(k):
        copy_contact(source[c], to[c])
