"""Rival answers: other places and forces of as many contacts that explain the readings nearly as well.

The likelihood of two contacts close together, or of one that few tactels feel, has more than one mode. The
curvature at the top of the highest says nothing of the others, so an answer with rivals is less sure than its
Fisher information claims. From each start (the closest pairs merged and split otherwise; a contact mirrored
at its nearest tactel) a fit climbs to its mode, and the covariance of an answer is that of the mixture::

    P = sum_m w_m (P_m + (x_m - x)(x_m - x)'),     w_m ~ exp(-chi^2_m / 2) |P_m|^(1/2) / F

w_m is the part of the posterior of mode m (Laplace), for a prior that is even in place. The answer is the
mode of the largest part; where it is flatter than its top, its own P_m is stretched first.

Failure: modes that no start reaches, and modes that are not round: a contact on one tactel alone.
Source: D. MacKay, Information Theory, Inference, and Learning Algorithms (2003), 27 (Laplace's method).
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.constants import FORCE_PRIOR, MAX_MOVE, SPLIT_OFFSETS
from skinbus.estimate.kernels.covariance import (
    MODE_LOG_FORCE,
    MODE_PLACE,
    add_normal_prior,
    add_prior,
    information,
    invert,
)
from skinbus.estimate.kernels.geometry import distance, surface_of, wrap
from skinbus.estimate.kernels.groups import weigh
from skinbus.estimate.kernels.law import affine, log_force_of
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.least_squares import (
    CONVERGED,
    GIVEN_UP,
    LOG_FORCE_MAX,
    LOG_FORCE_MIN,
    OFF_SKIN,
    descend,
    evaluate,
    factorise,
)
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.alike import SAME, interchangeable, leads_to, match, separate
from skinbus.estimate.levels.listed_fit import has_profile
from skinbus.estimate.levels.split_merge import clear_owners, copy_rows, merge_rows, own_nearest, split_row
from skinbus.jit import inner_kernel, runtime_int

UNDETERMINED = 4.5
"""Taken from the logarithm of a mode's mass for each contact that fewer than three tactels feel: 3 sigma."""
RIVAL = 14.0
"""Deviance above the best at which an answer is left out: it has a thousandth of the weight."""
NEARLY = (1.0, 0.1, 0.01)
"""A climb whose next step gains no more than such a chi^2, of one standard deviation or less, and leads to
the top of a known mode, is on that mode: most are, and the last steps to the top are half of a climb."""
NEAR = 0.030
"""m: contacts further apart hide nothing of each other that another split could explain."""
TURNS = 4
"""Directions of a split, 45 degrees apart: the halves are equal, so half a circle is all of it."""
PAIRS = 3
RIVAL_ITERATIONS = 25
FEW_READINGS = 5
"""A contact that no more tactels feel may have been mirrored at one of them, or at a line of them."""
SHIFTS = (-0.006, -0.003, 0.003, 0.006)
"""m, along the direction in which its place is least known, and across: modes are up to a pitch apart."""
FAR_OFF = 0.006
"""m: nearly half the diagonal of a pitch. A contact so far from the tactel that feels it most is
strong and off the tactels, or weak and near."""
NEARER = (0.0, 0.5)
"""Parts of that way at which the near one is looked for."""
FELT = 3.0
"""A tactel feels a contact if its pressure by the law is this many standard deviations."""


@inner_kernel
def explore(lay: Layout, w: Work, link: int, k: int, n: int, chi2: float) -> float:
    """Look for rivals of the k contacts fitted in ``theta``; leave the best in it and return its chi^2."""
    theta, path = w.theta, w.path
    w.n_rivals[0] = 0
    copy_rows(theta, path, k)
    note(lay, w, link, k, deviance(lay, w, link, k, n, theta) if has_profile(lay) else chi2)
    pairs = runtime_int(0)
    for u in range(k):
        for v in range(u + 1, k):
            if pairs == PAIRS or separate(lay, link, path[u], path[v]) > NEAR:
                continue
            pairs += 1
            for turn in range(TURNS):
                for size in range(len(SPLIT_OFFSETS)):
                    if is_over(w):
                        continue
                    copy_rows(path, theta, k)
                    merge_rows(lay, w, link, u, v)
                    split_row(lay, w, link, u, v, turn * math.pi / TURNS, SPLIT_OFFSETS[size])
                    climb(lay, w, link, k, n)
    bring_near(lay, w, link, k, n)
    for c in range(k):
        if is_over(w):
            break
        felt, t, away = weak_direction(lay, w, link, k, n, c)
        ds, da, rest = w.step[0], w.step[1], w.step[2]
        if away > FAR_OFF:
            for turn in range(len(NEARER)):
                if is_over(w):
                    continue
                copy_rows(path, theta, k)
                start_near(lay, w, link, theta, c, t, NEARER[turn], rest)
                climb(lay, w, link, k, n)
        if felt > FEW_READINGS:
            continue
        for turn in range(2 * len(SHIFTS)):
            if turn == len(SHIFTS):
                ds, da = -da, ds
            if is_over(w):
                continue
            copy_rows(path, theta, k)
            theta[c, 0] += SHIFTS[turn % len(SHIFTS)] * ds
            theta[c, 1] += SHIFTS[turn % len(SHIFTS)] * da
            theta[c, 2] = strength(lay, link, theta[c], w.list[t], rest)
            climb(lay, w, link, k, n)
    best, most = runtime_int(0), -math.inf
    for m in range(w.n_rivals[0]):
        if is_over(w):
            break
        mass = log_mass(lay, w, link, k, n, w.rival_theta[m])
        if mass > most:
            best, most = m, mass
    copy_rows(w.rival_theta[best], theta, k)
    if not has_profile(lay):
        return float(w.rival_chi2[best])
    weigh(lay, w, link, theta, k, n, 0.0)
    clear_owners(w, n)
    return float(evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)[0])


@inner_kernel
def bring_near(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Climb from where all contacts of ``path`` that are far off the tactels are right at them.

    One alone does not come back while another far off explains its tactels.
    """
    path, near = w.path, w.before
    copy_rows(path, near, k)
    far = runtime_int(0)
    for c in range(k):
        if is_over(w):
            return
        _, t, away = weak_direction(lay, w, link, k, n, c)
        if away > FAR_OFF:
            start_near(lay, w, link, near, c, t, 0.0, w.step[2])
            far += 1
    if far > 1:
        copy_rows(near, w.theta, k)
        climb(lay, w, link, k, n)


@inner_kernel
def start_near(lay: Layout, w: Work, link: int, to: Floats, c: int, t: int, way: float, p: float) -> None:
    """Put row c of a table this part of the way from listed tactel t, as strong as p (Pa) there asks."""
    path, i = w.path, w.list[t]
    to[c, 0] = lay.s[i] + way * (path[c, 0] - lay.s[i])
    to[c, 1] = lay.a[i] + way * wrap(path[c, 1] - lay.a[i], surface_of(lay.link, link).period)
    to[c, 2] = strength(lay, link, to[c], i, p)


@inner_kernel
def weak_direction(lay: Layout, w: Work, link: int, k: int, n: int, c: int) -> tuple[int, int, float]:
    """Write to ``step`` the unit vector (s, a) in which contact c of ``path`` is least known.

    Then follows the pressure (Pa) that the others leave to it at the tactel that feels it most. Returns how
    many tactels feel it, the place of that one in the list, and how far it is away (m).
    """
    path = w.path
    clear_owners(w, n)
    evaluate(lay, w, link, path, k, n, w.normal, w.gradient)
    felt, most, at, away = runtime_int(0), 0.0, runtime_int(0), 0.0
    for m in range(w.n_felt[c]):
        t, p = w.felt_at[c, m], w.felt[c, m, 3]
        if p > FELT * lay.sigma[w.list[t]]:
            felt += 1
        if p > most:
            most, at = p, t
    if most > 0.0:
        i = w.list[at]
        away = distance(surface_of(lay.link, link), path[c, 0], path[c, 1], lay.s[i], lay.a[i])
    w.step[2] = w.p[w.list[at]] - w.predicted[at] + most
    if felt > FEW_READINGS:
        return felt, at, away
    add_prior(w, k)
    invert(w, 3 * k)
    u = 3 * c
    ss, sa, aa = w.inverse[u, u], w.inverse[u, u + 1], w.inverse[u + 1, u + 1]
    angle = 0.5 * math.atan2(2.0 * sa, ss - aa)
    w.step[0], w.step[1] = math.cos(angle), math.sin(angle)
    return felt, at, away


@inner_kernel
def strength(lay: Layout, link: int, place: Floats, i: int, p: float) -> float:
    """Return the log force with which a contact at a place (s, a) makes p (Pa) at tactel i."""
    law = lay.law[i]
    d = distance(surface_of(lay.link, link), place[0], place[1], lay.s[i], lay.a[i])
    g, h = affine(lay.law_par, lay.law_table, law, d)
    amp = (max(p, lay.sigma[i]) - h) / max(g, 1e-9)
    return min(max(log_force_of(lay.law_par, law, amp), LOG_FORCE_MIN), LOG_FORCE_MAX)


@inner_kernel
def climb(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Fit ``theta`` and note where it ends."""
    if has_profile(lay):
        weigh(lay, w, link, w.theta, k, n, 0.0)
    own_nearest(lay, w, link, k, n)
    limit = math.inf
    # by the weights of a start a fit says nothing of what its end will have
    for m in range(0 if has_profile(lay) else w.n_rivals[0]):
        limit = min(limit, w.rival_chi2[m] + RIVAL)
    rest = runtime_int(RIVAL_ITERATIONS)
    here, is_here = evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient), True
    for turn in range(len(NEARLY)):
        if not is_here:
            here = evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
        _, status, done, here, is_here = descend(
            lay, w, link, k, n, MAX_MOVE, rest, NEARLY[turn], limit, here
        )
        if status in (GIVEN_UP, OFF_SKIN):
            return
        if status != CONVERGED:
            break
        rest -= done
        for m in range(w.n_rivals[0]):
            if leads_to(lay, w, link, k, w.rival_theta[m]):
                return
    note(lay, w, link, k, deviance(lay, w, link, k, n, w.theta))


@inner_kernel
def deviance(lay: Layout, w: Work, link: int, k: int, n: int, theta: Floats) -> float:
    """Return chi^2 of ``theta``; under a law with a misfit profile with its own weights, and their logarithm.

    What such a law leaves grows with the force: by the weights of a strong answer any would be likely.
    """
    density = 0.0
    if has_profile(lay):
        weigh(lay, w, link, theta, k, n, 0.0)
        for t in range(n):
            density += math.log(w.weight[t])
    clear_owners(w, n)
    chi2, _, _ = evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
    return float(chi2 - density)


@inner_kernel
def note(lay: Layout, w: Work, link: int, k: int, chi2: float) -> None:
    """Keep ``theta`` as a rival, unless it is one already or too bad to be one."""
    chi2s, tables = w.rival_chi2, w.rival_theta
    n = w.n_rivals[0]
    worst = runtime_int(0)
    for m in range(n):
        if chi2 > chi2s[m] + RIVAL:
            return
        if chi2s[m] > chi2s[worst]:
            worst = m
    for m in range(n):
        if match(lay, w, link, k, w.theta, tables[m]) < SAME:
            if chi2 < chi2s[m]:
                chi2s[m] = chi2
                copy_rows(w.theta, tables[m], k)
            return
    if n == len(chi2s):
        if chi2 >= chi2s[worst]:
            return
        n = worst
    else:
        w.n_rivals[0] = n + 1
    chi2s[n] = chi2
    copy_rows(w.theta, tables[n], k)


@inner_kernel
def log_mass(lay: Layout, w: Work, link: int, k: int, n: int, theta: Floats) -> float:
    """Return the logarithm of the posterior on the mode of ``theta``.

    A mode is no wider than ``MODE_PLACE`` and ``MODE_LOG_FORCE``; one on which a contact is felt by fewer
    than three tactels counts less.
    """
    mass = -0.5 * deviance(lay, w, link, k, n, theta)
    for c in range(k):
        mass += FORCE_PRIOR * theta[c, 2]
        felt = 0
        for m in range(w.n_felt[c]):
            if w.felt[c, m, 3] > FELT * lay.sigma[w.list[w.felt_at[c, m]]]:
                felt += 1
        if felt < 3:
            mass -= UNDETERMINED
    add_normal_prior(w, k, MODE_PLACE, MODE_LOG_FORCE)
    damping = 0.0
    while not factorise(w, w.normal, 3 * k, damping):
        damping = max(10.0 * damping, 1e-13)
    for u in range(3 * k):
        mass += 0.5 * math.log(w.pivot[u])
    return mass


@inner_kernel
def blend(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Make the covariances of the answer in ``theta`` those of the mixture with its rivals.

    They are in the columns of ``members`` already, for the answer alone.
    """
    theta, covariance, members, period = w.theta, w.covariance, w.members, surface_of(lay.link, link).period
    if w.n_rivals[0] < 2:
        return
    own = log_mass(lay, w, link, k, n, theta)
    total = 1.0
    for m in range(w.n_rivals[0]):
        if is_over(w):
            break
        rival = w.rival_theta[m]
        if match(lay, w, link, k, theta, rival) < SAME:
            continue
        weight = math.exp(min(log_mass(lay, w, link, k, n, rival) - own, 5.0))
        total += weight
        information(lay, w, link, k, n, rival)
        match(lay, w, link, k, theta, rival)
        for c in range(k):
            to = members[c]
            likely = 0
            for e in range(k):
                likely += interchangeable(lay, w, link, k, theta, rival, c, e)
            for e in range(k):
                if not interchangeable(lay, w, link, k, theta, rival, c, e):
                    continue
                force = math.exp(rival[e, 2])
                off = w.step
                off[0] = rival[e, 0] - theta[c, 0]
                off[1] = wrap(rival[e, 1] - theta[c, 1], period)
                off[2] = force - math.exp(theta[c, 2])
                for x in range(3):
                    for y in range(3):
                        p = w.inverse[3 * e + x, 3 * e + y]
                        p *= (force if x == 2 else 1.0) * (force if y == 2 else 1.0)
                        covariance[to, x, y] += weight / likely * (p + off[x] * off[y])
    for c in range(k):
        for x in range(3):
            for y in range(3):
                covariance[members[c], x, y] /= total
