"""The size of what presses: estimated with place and force where the law may not be that of what presses.

A law that ships with a board is that of fingertips. A tip or a thumb presses another field (``disc_shapes``),
and place and force by that law are off by many of their standard deviations. So once contacts are found, each
group is solved again for s, a, log force and size u of its contacts (``sized_answers``) from the answer for
fingertips. What is left of the misfit of the law is that of gains and of the modes. A law that was learned is
that of its indenter until the readings refute it (``learned_size``).

Where the tactels do not determine a size, amid four of a coarse array, place and force follow it on a curve.
Its prior is then a mixture: of fingertips, tips and thumbs for a lone contact, of fingertips and any size for
those with a core in common. Each part gives an answer that is nearly linear in the size. The contact is that
of fingertips unless the readings refute it, else the mean of all parts, and its covariance has the second
moments of all parts about it, and what an indenter that is not round would change (``contact_shape``).

Assumption: what presses acts like a uniform disc of 2 to 25 mm. Failure: two tips close together may be one
wide contact; contacts on fewer than three tactels stay as they are.
Source: D. Titterington, A. Smith, U. Makov, Statistical Analysis of Finite Mixture Distributions (1985), 2.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.constants import BAD_FIT, FEW_TACTELS, OVER_BUDGET
from skinbus.estimate.kernels.disc_shapes import ANY_SIZE, FINGERS, SHARES, SIZES, SPREADS
from skinbus.estimate.kernels.geometry import surface_of, wrap
from skinbus.estimate.kernels.groups import (
    PLACE_SLACK,
    add_background,
    group_contacts,
    list_tactels,
    load_group,
    rank_groups,
    reach_of,
)
from skinbus.estimate.kernels.law import SHAPED
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import MAX_ITERATIONS, OFF_SKIN, evaluate
from skinbus.estimate.kernels.sized_contacts import evaluate_sized, width_of
from skinbus.estimate.kernels.workspace import SIZE_ANSWERS, Work
from skinbus.estimate.levels.contact_shape import UNKNOWN_FORCE, allow_for_shape
from skinbus.estimate.levels.contact_width import expected
from skinbus.estimate.levels.fit import MISFIT_LIMIT, store_group
from skinbus.estimate.levels.learned_size import (
    OF_FINGERS,
    REFUTED_LAW,
    UNLIKELY,
    doubt_sizes,
    has_learned,
    is_faint,
    is_same,
    keep_learned,
    own_part,
    rate_linear,
    rate_wide,
    start_at_top,
    take_own_sizes,
    wrong_by,
)
from skinbus.estimate.levels.listed_fit import fit_listed
from skinbus.estimate.levels.long_contact import SURE, allow_for_bars, weigh_bars
from skinbus.estimate.levels.posterior import BROAD, restart
from skinbus.estimate.levels.sized_answers import (
    average_answers,
    moments_about,
    solve_sizes,
    weigh_sized,
)
from skinbus.estimate.levels.split_merge import clear_owners, copy_rows
from skinbus.jit import inner_kernel, runtime_int

REFUTED = 0.05
"""Posterior share below which what presses is no fingertip: then, and for small discs, the answer is the mean
of all parts. At 0.5 the force of a finger of 12 mm on seams is 23 % off in place of 14."""
KNOWN = 0.1
"""Standard deviation of u below which place and force are linear in it."""
TIPS = -0.25
"""u of a disc of 9 mm: fields of smaller ones differ less and less, so that there is another mode."""
ENOUGH = 6
"""Tactels that a contact reaches from which on there is one mode: two more than it has unknowns."""
TOO_LARGE = 1.15
"""u of a disc of 28 mm: what looks larger is a bar, or several touches; thumbs of 25 mm have 0.95."""
HELD_SIZE = 0.02
"""Standard deviation of u with which an answer begins: place and force come to its size first. From the place
as learned all three together end on the curve between the two sizes."""
MIXED = 16.0
"""Variance of a place, relative to that with its size, from which on an answer has other modes and stays."""


@inner_kernel
def size_contacts(lay: Layout, w: Work) -> None:
    """Estimate the sizes of contacts that have a law which was not measured with what presses."""
    has_modes = False
    for law in range(len(lay.law_par)):
        has_modes |= lay.law_par[law, SHAPED] != 0.0
    for c in range(w.n_contacts[0]):
        w.width_sd[c] = 0.0
    if not has_modes or w.n_contacts[0] == 0:
        return
    if is_over(w):
        for c in range(w.n_contacts[0]):
            w.quality[c] |= OVER_BUDGET
        return
    group_contacts(lay, w, 0.0, 0.0)
    for o in range(rank_groups(w)):
        size_group(lay, w, w.turn[o])
    doubt_unsized(lay, w)


@inner_kernel
def doubt_unsized(lay: Layout, w: Work) -> None:
    """Flag contacts that have no size and are wider than any disc: palms, zeros that rise together."""
    for c in range(w.n_contacts[0]):
        if w.width_sd[c] == 0.0 and w.width[c] > 1.0:
            largest, _ = width_of(lay, lay.patch_start[w.patch[c]], TOO_LARGE)
            if w.width[c] > largest > 1.0:
                w.quality[c] |= BAD_FIT


@inner_kernel
def size_group(lay: Layout, w: Work, first: int) -> None:
    """Estimate sizes, places and forces of a group; write them with their covariance."""
    theta, members, link = w.theta, w.members, w.link[first]
    k = load_group(w, first)
    if is_over(w):
        for c in range(k):
            w.quality[members[c]] |= OVER_BUDGET
        return
    for c in range(k):
        to = members[c]
        if w.level[to] == 0 or w.quality[to] & (FEW_TACTELS | OVER_BUDGET) or w.status[to] == OFF_SKIN:
            return
    n = list_tactels(lay, w, link, k, 0.0, PLACE_SLACK, 0.0)
    if n == 0:
        return
    add_background(lay, w, link, first, k, n)
    is_learned = has_learned(lay, w, n)
    is_wide, as_wide, as_learned, fits, faint = False, -math.inf, -math.inf, False, False
    quality = w.quality[members[0]]
    if is_learned and k == 1 and theta[0, 3] != 1.0:
        is_wide, n = take_law_width(lay, w, link, first, n)
        if w.quality[members[0]] & OVER_BUDGET:
            return
    weigh_sized(lay, w, k, n, 0.0)
    for c in range(k):
        w.before[c, 3] = 0.0
    has_width = False
    if is_learned:
        if is_wide:
            copy_rows(w.wide, theta, 1)
            as_wide = rate_wide(lay, w, link, runtime_int(1), n)
            faint = is_faint(lay, w, link, k, n)
            load_group(w, first)
        for c in range(k):
            has_width |= theta[c, 3] != 1.0
        if has_width:
            as_learned = rate_wide(lay, w, link, k, n)
        fits = take_own_sizes(lay, w, link, k, n) <= expected(k, n) and not has_width
        faint = is_faint(lay, w, link, k, n) if not is_wide else faint
        if not has_width:
            as_learned, other = rate_linear(lay, w, link, k, n)
            if fits and math.exp(min(other - as_learned, 50.0)) * (1.0 - OF_FINGERS) / OF_FINGERS < UNLIKELY:
                return
        for c in range(k):
            w.before[c, 3] = theta[c, 3]
    for c in range(k):
        for x in range(3):
            w.before[c, x] = theta[c, x]
    n_answers = runtime_int(2)
    if is_learned and k == 1 and not has_width:
        copy_rows(w.before, theta, 1)
        learned = runtime_int(SIZE_ANSWERS - 2)
        solve_sizes(lay, w, link, runtime_int(1), n, learned, w.before[0, 3], HELD_SIZE, 1.0)
        as_learned = max(w.rate[learned], as_learned)
        for x in range(3 if is_wide else 0):
            w.before[0, x] = w.wide[0, x]
    copy_rows(w.before, theta, k)
    if is_learned:
        weigh_sized(lay, w, k, n, wrong_by(ANY_SIZE))
    chi2, is_last = solve_sizes(lay, w, link, k, n, runtime_int(1), 0.0, ANY_SIZE, 1.0 - FINGERS)
    w.rate[0] = -math.inf
    known, small = w.rate[1] > -math.inf and chi2 <= expected(k, n), False
    for c in range(k):
        known &= w.inverse[3 * k + c, 3 * k + c] <= KNOWN * KNOWN and w.n_tactels[members[c]] >= ENOUGH
        small |= theta[c, 3] < TIPS
    known &= not fits  # near a law that fits there is a mode, and for tips there may be another one
    if k > 1 and (small or not known):
        copy_rows(w.before, theta, k)
        solve_sizes(lay, w, link, k, n, runtime_int(0), 0.0, SPREADS[0], FINGERS)
    elif small or not known:
        n_answers = solve_priors(lay, w, link, n, is_learned, fits)
    learned = runtime_int(-1)
    if is_learned:
        learned = n_answers
        keep_learned(lay, w, k, learned, as_learned)
        n_answers += 1
        if is_wide:
            move_wide(w, n_answers, as_wide)
            n_answers += 1
    best = 1
    for j in range(n_answers):
        best = j if w.rate[j] > w.rate[best] else best
    if is_over(w):
        for c in range(k):
            w.quality[members[c]] |= OVER_BUDGET
        return
    if w.rate[best] == -math.inf:
        return
    top, total = w.rate[best], 0.0
    for j in range(n_answers):
        total += math.exp(w.rate[j] - top)
    for j in range(n_answers):
        w.rate[j] = math.exp(w.rate[j] - top) / total
    refuted = is_learned and w.rate[learned] < REFUTED_LAW
    if is_wide and refuted and w.rate[learned + 1] >= (w.rate[learned] if faint else REFUTED_LAW):
        take_wide(w, learned + 1, quality)
        doubt_sizes(lay, w, link, k, n_answers, learned + 1)
        return
    if is_learned and (faint or not refuted):
        doubt_sizes(lay, w, link, k, n_answers, learned)
        return
    likely = not known and w.rate[0] >= REFUTED and not is_learned
    if small or not (known and is_last) or is_learned:
        copy_rows(w.sized[0 if likely else best], theta, k)
        for c in range(0 if likely else k):
            average_answers(w, c, n_answers, surface_of(lay.link, link).period)
        evaluate_sized(lay, w, link, theta, k, n, 0.0, ANY_SIZE, w.normal, w.gradient)
    write_answer(lay, w, link, k, n, n_answers, known, is_learned)


@inner_kernel
def take_law_width(lay: Layout, w: Work, link: int, first: int, n: int) -> tuple[bool, int]:
    """Fit the wide contact of ``theta``, amid n listed tactels, again with the width of its law.

    It may have become wide in another mode. What it was is kept in ``wide`` and the last answer. Returns
    whether there is such a fit, and how many tactels are listed then.
    """
    to, theta, one = w.members[0], w.theta, runtime_int(1)
    copy_rows(theta, w.wide, 1)
    w.before[0, 3] = 0.0
    keep_learned(lay, w, one, runtime_int(SIZE_ANSWERS - 1), 0.0)
    clear_owners(w, n)
    evaluate(lay, w, link, theta, 1, n, w.normal, w.gradient)
    found = restart(lay, w, link, runtime_int(0), n)
    status = OFF_SKIN
    if found:
        n, _, status, _ = fit_listed(lay, w, link, first, one, runtime_int(MAX_ITERATIONS))
    if status != OFF_SKIN and not is_over(w):
        store_group(lay, w, link, one, n, status, w.level[to])
    load_group(w, first)
    n = list_tactels(lay, w, link, one, 0.0, PLACE_SLACK, 0.0)
    add_background(lay, w, link, first, one, n)
    return w.width[to] == 1.0, n


@inner_kernel
def move_wide(w: Work, j: int, rate: float) -> None:
    """Make the wide answer that was kept answer j; ``rate`` is the log of its evidence."""
    kept = SIZE_ANSWERS - 1
    w.rate[j] = rate
    for x in range(4):
        w.sized[j, 0, x] = w.sized[kept, 0, x] if x < 3 else w.before[0, 3]
        for y in range(4):
            w.sized_moment[j, 0, x, y] = w.sized_moment[kept, 0, x, y]


@inner_kernel
def take_wide(w: Work, j: int, quality: int) -> None:
    """Write the wide answer j to the contact again, and its quality."""
    to = w.members[0]
    w.quality[to] = quality
    w.s[to], w.a[to], w.log_force[to] = w.sized[j, 0, 0], w.sized[j, 0, 1], w.sized[j, 0, 2]
    w.width[to], w.averaged[to] = w.wide[0, 3], False


@inner_kernel
def solve_priors(lay: Layout, w: Work, link: int, n: int, is_learned: bool, fits: bool) -> int:
    """Solve for the contact in ``before`` with each part of the prior of sizes; return the number of answers.

    A law that was learned with a fingertip is that part; tips differ more among themselves. A learned law may
    have led to a mode beyond the rim: tips, and all where it does not fit, are also solved for from within.
    """
    n_answers, own, part = runtime_int(len(SIZES)), w.before[0, 3], runtime_int(-1)
    if is_learned and own_part(own) == 0:
        part = runtime_int(0)
        w.rate[part] = -math.inf
    for turn in range(2 * len(SIZES) if is_learned else len(SIZES)):
        j = turn % len(SIZES)
        if j == part or (turn >= len(SIZES) and fits and SIZES[j] > TIPS):
            continue
        to, share = runtime_int(j), SHARES[j]
        copy_rows(w.before, w.theta, 1)
        w.theta[0, 3] = SIZES[j]
        if is_learned:
            share = 1.0 / 3.0 if part < 0 else 0.5
            weigh_sized(lay, w, 1, n, wrong_by(max(abs(SIZES[j] - own), SPREADS[j])))
            if turn >= len(SIZES):
                if not start_at_top(lay, w, n, SIZES[j]):
                    continue
                to, n_answers = n_answers, n_answers + 1
            solve_sizes(lay, w, link, runtime_int(1), n, to, SIZES[j], HELD_SIZE, share)
        solve_sizes(lay, w, link, runtime_int(1), n, to, SIZES[j], SPREADS[j], share)
        if to != j and is_same(w, j, to):
            w.rate[j if w.rate[to] > w.rate[j] else to] = -math.inf
    return n_answers


@inner_kernel
def write_answer(
    lay: Layout, w: Work, link: int, k: int, n: int, n_answers: int, known: bool, is_learned: bool
) -> None:
    """Write the contacts in ``theta``, as evaluated last, and the second moments of all answers about them.

    Where sizes are not known, so is the posterior mean of a contact at a rim: a broad one stays.
    """
    theta, off, moment = w.theta, w.step, w.normal_trial
    period = surface_of(lay.link, link).period
    n_bars = runtime_int(0)
    if k == 1:
        n_bars = weigh_bars(lay, w, link, n, theta[0, 3])
    for c in range(k):
        to, chi2 = w.members[c], 0.0
        moments_about(w, c, theta[c], n_answers, period)
        if w.averaged[to] and not (known or is_learned):
            cov = w.mean_covariance[to]
            if cov[0, 0] + cov[1, 1] > BROAD * BROAD:
                continue
            off[0], off[1] = w.mean[to, 0] - theta[c, 0], wrap(w.mean[to, 1] - theta[c, 1], period)
            off[2] = math.exp(w.mean[to, 2]) - math.exp(theta[c, 2])
            for x in range(3):
                for y in range(3):
                    moment[x, y] += off[x] * off[y]
        before = w.covariance[to, 0, 0] + w.covariance[to, 1, 1]
        if not is_learned and before > MIXED * w.wider_by[to] * (moment[0, 0] + moment[1, 1]):
            continue
        w.averaged[to] = False
        for m in range(w.n_felt[c]):
            t = w.felt_at[c, m]
            residual = w.p[w.list[t]] - w.predicted[t]
            chi2 += w.weight[t] * residual * residual if w.counts[t] > 0.0 else 0.0
        wide, _ = width_of(lay, w.nearest_tactel[c], theta[c, 3])
        share = allow_for_shape(lay, w, link, c, n, theta[c], wide)
        for x in range(4):
            for y in range(4):
                moment[x, y] += share * (off[x] * off[y])
        is_unknown = k == 1 and not is_learned and moment[2, 2] > (UNKNOWN_FORCE * math.exp(theta[c, 2])) ** 2
        far = allow_for_bars(w, n_bars)
        w.s[to], w.a[to], w.log_force[to] = theta[c, 0], wrap(theta[c, 1], period), theta[c, 2]
        w.width[to], by_size = width_of(lay, w.nearest_tactel[c], theta[c, 3])
        w.width_sd[to] = abs(by_size) * math.sqrt(moment[3, 3])
        describe_sized(lay, w, to, chi2, w.n_felt[c])
        if is_unknown:
            w.quality[to] |= FEW_TACTELS
        if far > SURE or (theta[c, 3] > TOO_LARGE and not is_learned):
            w.quality[to] |= BAD_FIT


@inner_kernel
def describe_sized(lay: Layout, w: Work, to: int, chi2: float, n: int) -> None:
    """Write covariance, residual, reach and quality of a contact by the chi^2 of its n tactels."""
    w.contact_reach[to] = reach_of(lay, w.log_force[to], w.width[to])
    w.residual[to] = math.sqrt(chi2 / max(n, 1))
    most = n + MISFIT_LIMIT * math.sqrt(2.0 * n)
    wrong = max(chi2 / most, 1.0) if n > 0 else 1.0
    w.quality[to] &= ~BAD_FIT
    if wrong > 1.0:
        w.quality[to] |= BAD_FIT
    for x in range(3):
        for y in range(3):
            w.covariance[to, x, y] = wrong * w.normal_trial[x, y]
