"""Level ``fit``: the contacts of the clusters, refined to the most likely ones, with what is known of them.

The covariance is the inverse of the Fisher information J'WJ with a wide normal prior added (place:
``PRIOR_PLACE``, log force: ``PRIOR_LOG_FORCE``), so that what the tactels do not determine is reported as
unknown instead of being infinite. The prior takes no part in the fit. It is the covariance of the mode of the
answer; level ``full`` also looks for other modes (``modes``).

Source: S. Kay, Fundamentals of Statistical Signal Processing I (1993), 3.9 (Fisher information).
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.board_offset import UNSURE
from skinbus.estimate.kernels.censored import censor
from skinbus.estimate.kernels.constants import (
    BAD_FIT,
    FEW_TACTELS,
    FULL_SCALE,
    NOT_CONVERGED,
    OVER_BUDGET,
)
from skinbus.estimate.kernels.covariance import PRIOR_LOG_FORCE, PRIOR_PLACE, add_prior, invert
from skinbus.estimate.kernels.geometry import surface_of, wrap
from skinbus.estimate.kernels.groups import (
    PLACE_SLACK,
    group_contacts,
    load_group,
    rank_groups,
    reach_of,
)
from skinbus.estimate.kernels.law import affine, log_force_of, peak_pressure
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.least_squares import (
    CONVERGED,
    LOG_FORCE_MAX,
    LOG_FORCE_MIN,
    MAX_ITERATIONS,
)
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.estimate.levels.contact_width import expected, widen
from skinbus.estimate.levels.listed_fit import (
    FEWEST,
    REACHED,
    fit_listed,
    has_profile,
    has_readings,
    is_unsized,
)
from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.estimate.levels.other_starts import WEAK, leave_out_weak, try_again
from skinbus.estimate.levels.posterior import integrate_contacts
from skinbus.estimate.levels.split_merge import close_gaps, remove_row, resize_group
from skinbus.jit import inner_kernel, runtime_int

SURE = 4.0
"""Times the chi^2 that a contact must save, from which on it will be one whatever becomes of those around."""
FEW_PLACE = 0.01
"""m, a pitch: what fewer than three tactels leave open."""
FAINTEST = 0.01
"""Part of its peak below which a radial law is not inverted."""
MISFIT_LIMIT = 4.0
"""Standard deviations by which chi^2 may exceed its mean before the law is said not to fit."""


@inner_kernel
def refine_contacts(lay: Layout, w: Work) -> None:
    """Fit every group of contacts, and again what then turns out to belong together.

    Groups are made of the starts, and once more of the answers: a contact that has grown on to another's
    tactels is solved with it then. So is anew who had started with a neighbour on its tactels, unless that is
    done with its size.
    """
    group, before, seen, again = w.group, w.group_before, w.group_seen, w.group_again
    group_contacts(lay, w, 0.0, PLACE_SLACK)
    for c in range(w.n_contacts[0]):
        again[c] = True
        seen[c] = False
    overlap = refine_groups(lay, w)
    for c in range(w.n_contacts[0]):
        before[c] = group[c]
        again[c] = False
    if overlap and not is_over(w):
        group_contacts(lay, w, 0.0, 0.0)
        for c in range(w.n_contacts[0]):
            again[group[c]] |= seen[before[c]] or before[c] != before[group[c]]
        refine_groups(lay, w)
    close_gaps(w)


@inner_kernel
def refine_groups(lay: Layout, w: Work) -> bool:
    """Fit the groups that are to be solved now, and return whether any has felt others."""
    overlap = False
    for o in range(rank_groups(w)):
        c = w.turn[o]
        if w.alive[c] and w.group_again[c]:
            overlap |= refine_group(lay, w, c)
    return overlap


@inner_kernel
def refine_group(lay: Layout, w: Work, first: int) -> bool:
    """Fit the contacts of a group; return whether they feel what contacts outside press on.

    Notes in ``group_seen`` whether they are to be solved again for that.
    """
    k = load_group(w, first)
    link = w.link[first]
    w.group_seen[first] = False
    if is_over(w):
        say_over_budget(w, k)
        return False
    k_before, is_sure, off_s, off_a = k, False, 0.0, 0.0
    n, chi2, status, seen = fit_listed(lay, w, link, first, k, runtime_int(MAX_ITERATIONS))
    if k > 1 and chi2 > expected(k, n) and not is_over(w):
        k, n, chi2, status, seen = leave_out_weak(lay, w, link, first, k, n, chi2, status, seen)
    if k == 1 and chi2 > expected(k, n) and has_profile(lay) and not is_over(w):
        n, chi2, status, seen = try_again(lay, w, link, first, n, chi2)
    if k > 0 and chi2 > expected(k, n) and not is_over(w):
        widen(lay, w, link, k, n, chi2)
        n, _, status, seen = fit_listed(lay, w, link, first, k, runtime_int(MAX_ITERATIONS))
    while k > 0:
        weakest, saved = least_worth(lay, w, link, k, n)
        is_sure = saved >= SURE * needed(lay, w, weakest)
        # alone on a tactel that is held: it has proved itself before, and may fade until it is released
        if saved >= needed(lay, w, weakest) or (
            k == 1 and w.nearest_tactel[0] >= 0 and w.held[w.nearest_tactel[0]]
        ):
            break
        if is_over(w):  # others need a fit without it
            say_over_budget(w, k_before)
            return seen
        if k == 1 and touched_for_sure(lay, w, n):
            # a law that cannot explain a touch does not make it go away: its start is off by the fit's way
            s, a = w.theta[0, 0], w.theta[0, 1]
            load_group(w, first)
            n, _, status, seen = fit_listed(lay, w, link, first, k, runtime_int(0))
            off_s = w.theta[0, 0] - s
            off_a = wrap(w.theta[0, 1] - a, surface_of(lay.link, link).period)
            break
        remove_row(w.theta, weakest, k)
        k -= 1
        if k > 0:
            n, _, status, seen = fit_listed(lay, w, link, first, k, runtime_int(MAX_ITERATIONS))
    resize_group(w, first, k_before, k, link)
    if k > 0:
        is_sized_later = is_sure and is_unsized(lay, w, n) and has_readings(lay, w, k)
        w.group_seen[first] = seen and not is_sized_later
        store_group(lay, w, link, k, n, status, runtime_int(1))
        cov = w.covariance[w.members[0]]
        cov[0, 0], cov[1, 1] = cov[0, 0] + off_s * off_s, cov[1, 1] + off_a * off_a
        cov[0, 1], cov[1, 0] = cov[0, 1] + off_s * off_a, cov[1, 0] + off_s * off_a
    return seen


@inner_kernel
def needed(lay: Layout, w: Work, c: int) -> float:
    """Return the chi^2 that contact c of ``theta`` must save to be one."""
    home = w.nearest_tactel[c]
    return EVIDENCE * (UNSURE if home >= 0 and w.shifted[lay.patch[home]] else 1.0)


@inner_kernel
def say_over_budget(w: Work, k: int) -> None:
    """Leave the k contacts of a group as they are and say why; what no fit has proved must do without it."""
    for c in range(k):
        to = w.members[c]
        w.quality[to] |= OVER_BUDGET
        if w.level[to] == 0 and w.evidence[to] < EVIDENCE:
            w.alive[to] = False


@inner_kernel
def say_all_over_budget(w: Work, level: int) -> None:
    """Say of all contacts below a level that no time was left for it."""
    for c in range(w.n_contacts[0]):
        if w.alive[c] and w.level[c] < level:
            w.members[0] = c
            say_over_budget(w, runtime_int(1))


@inner_kernel
def touched_for_sure(lay: Layout, w: Work, n: int) -> bool:
    """Return whether the listed tactels that reach their thresholds are more than noise together.

    Those whose readings contacts outside explain are theirs.
    """
    evidence = 0.0
    for t in range(n):
        i = w.list[t]
        least = max(lay.threshold[i], WEAK * w.p[i])
        if w.p[i] >= least and abs(w.p[i] - w.background[t]) >= least:
            evidence += (w.p[i] / lay.sigma[i]) ** 2
    return evidence >= EVIDENCE


@inner_kernel
def least_worth(lay: Layout, w: Work, link: int, k: int, n: int) -> tuple[int, float]:
    """Return the contact of ``theta``, as fitted last, that saves least of chi^2, and how much."""
    weakest, least = runtime_int(0), math.inf
    for c in range(k):
        saved = 0.0
        for m in range(w.n_felt[c]):
            t = w.felt_at[c, m]
            i = w.list[t]
            residual = w.p[i] - w.predicted[t]
            without = residual + w.felt[c, m, 3]
            if w.state[i] == SATURATED:
                residual, without = max(residual, 0.0), max(without, 0.0)
            saved += w.weight[t] * (without * without - residual * residual)
        if saved < least:
            weakest, least = c, saved
    return weakest, least


@inner_kernel
def store_group(lay: Layout, w: Work, link: int, k: int, n: int, status: int, level: int) -> bool:
    """Write the k contacts in ``theta``, as fitted last, to the columns of ``members``, and what is known.

    A fit that has not arrived is as wrong as the step that is left: its square is added to the covariance. So
    is that of the way from the mode to the mean, where readings at full scale make them two.
    Returns whether a contact was integrated over: then other tactels are listed.
    """
    theta, members, inverse, left = w.theta, w.members, w.inverse, w.step
    period = surface_of(lay.link, link).period
    add_prior(w, k)
    invert(w, 3 * k)
    for u in range(3 * k):
        left[u] = 0.0
        for v in range(3 * k):
            left[u] += inverse[u, v] * w.gradient[v]
    censor(w, k, n)
    for u in range(3 * k):
        most = PRIOR_LOG_FORCE if u % 3 == 2 else PRIOR_PLACE
        left[u] = min(max(left[u], -most), most)
    for c in range(k):
        to = members[c]
        force = math.exp(theta[c, 2])
        w.s[to], w.a[to], w.log_force[to] = theta[c, 0], wrap(theta[c, 1], period), theta[c, 2]
        w.contact_reach[to] = reach_of(lay, theta[c, 2], theta[c, 3])
        w.span[0] = max(w.span[0], w.contact_reach[to])
        if to < w.n_ordered[0]:
            w.span[1] = max(w.span[1], abs(theta[c, 0] - w.s_before[to]))
        w.width[to] = theta[c, 3]
        w.link[to], w.level[to], w.status[to] = link, level, status
        w.integrated[to] = w.averaged[to] = False
        u = 3 * c
        for x in range(3):
            for y in range(3):
                w.covariance[to, x, y] = inverse[u + x, u + y] + left[u + x] * left[u + y]
        for x in range(3):
            w.covariance[to, x, 2] *= force
            w.covariance[to, 2, x] *= force
        # on a line of tactels the force changes with the square of what is unknown across it
        bend = max(w.covariance[to, 0, 0], w.covariance[to, 1, 1]) / (PRIOR_PLACE * PRIOR_PLACE)
        w.covariance[to, 2, 2] += (PRIOR_LOG_FORCE * bend * force) ** 2
    describe_fit(lay, w, link, k, n, status)
    return (k == 1 or level == 1) and integrate_contacts(lay, w, link, k, level)


@inner_kernel
def force_from_afar(laws: Floats, tables: Floats, law: int, log_force: float, d: float) -> float:
    """Return the force (N) that makes the peak pressure of a contact at distance d (m) from where it is."""
    g0, _ = affine(laws, tables, law, 0.0)
    g, h = affine(laws, tables, law, d)
    peak = peak_pressure(laws, tables, law, log_force)
    log_far = log_force_of(laws, law, (peak - h) / max(g, FAINTEST * g0))
    return math.exp(min(max(log_far, LOG_FORCE_MIN), LOG_FORCE_MAX))


@inner_kernel
def describe_fit(lay: Layout, w: Work, link: int, k: int, n: int, status: int) -> None:
    """Write residual, tactels, patch and quality of the k contacts just stored."""
    laws, tables, p, state, theta = lay.law_par, lay.law_table, w.p, w.state, w.theta
    for c in range(k):
        to = w.members[c]
        in_reach, chi2, reached, quality = w.n_felt[c], 0.0, 0, w.quality[to] & OVER_BUDGET
        home = w.nearest_tactel[c] if w.nearest_tactel[c] >= 0 else w.list[0]
        for m in range(in_reach):
            t = w.felt_at[c, m]
            i = w.list[t]
            if w.felt[c, m, 3] > REACHED * lay.sigma[i]:
                reached += 1
            residual = p[i] - w.predicted[t]
            if state[i] == SATURATED:
                quality |= FULL_SCALE
                residual = max(residual, 0.0)
            chi2 += w.weight[t] * residual * residual
        if is_over(w):
            quality |= OVER_BUDGET
        if reached < FEWEST:
            quality |= FEW_TACTELS
            # another place with another force may read the same: the curvature here says nothing of it
            w.covariance[to, 0, 0] += FEW_PLACE * FEW_PLACE
            w.covariance[to, 1, 1] += FEW_PLACE * FEW_PLACE
            place = math.sqrt(max(w.covariance[to, 0, 0], w.covariance[to, 1, 1]))
            w.covariance[to, 2, 2] += force_from_afar(laws, tables, lay.law[home], theta[c, 2], place) ** 2
        if status != CONVERGED:
            quality |= NOT_CONVERGED
        w.wider_by[to] = 1.0
        most = in_reach + MISFIT_LIMIT * math.sqrt(2.0 * in_reach)
        if chi2 > most:
            quality |= BAD_FIT
            # so much is the law wrong by, and what it says of place and force; yet it is on the board
            variance = max(w.covariance[to, 0, 0], w.covariance[to, 1, 1])
            wrong = max(min(chi2 / most, PRIOR_PLACE * PRIOR_PLACE / variance), 1.0)
            w.wider_by[to] = wrong
            for x in range(3):
                for y in range(3):
                    w.covariance[to, x, y] *= wrong
        w.n_tactels[to], w.quality[to], w.patch[to] = reached, quality, lay.patch[home]
        w.residual[to] = math.sqrt(chi2 / max(in_reach, 1))
