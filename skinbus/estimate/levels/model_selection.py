"""Level ``full``: how many contacts a group has, by penalised likelihood, with moves that change the count.

::

    a contact more is believed if it lowers chi^2 by more than PENALTY max(1, chi^2 / degrees of freedom)

with the chi^2 of the richer answer on the right, so that a law which does not fit is not compensated by
contacts. Moves: merge a pair into one, drop the weakest; add one at the largest residual, split
one in two along the axis of its residuals. Each is followed by a fit of the whole group. For the choice
a reading counts with an error of at least ``DOUBT`` of itself, for the answer with what the law claims.

Failure: two contacts nearer than half a pitch look like a larger one; a valley that no move crosses.
Source: G. Schwarz, Estimating the dimension of a model (1978), for the form of the penalty.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.constants import MAX_MOVE, SPLIT_OFFSETS
from skinbus.estimate.kernels.covariance import stretch
from skinbus.estimate.kernels.geometry import distance, surface_of
from skinbus.estimate.kernels.groups import (
    add_background,
    group_contacts,
    list_tactels,
    load_group,
    rank_groups,
    weigh,
)
from skinbus.estimate.kernels.law import MISFIT, affine, amplitude, log_force_of, peak_pressure, reach
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.least_squares import (
    LOG_FORCE_MAX,
    LOG_FORCE_MIN,
    MAX_ITERATIONS,
    OFF_SKIN,
    evaluate,
    fit,
)
from skinbus.estimate.kernels.workspace import OWNED, SATURATED, Work
from skinbus.estimate.levels.contact_width import GOOD, WORTH_WIDTH, expected, widen
from skinbus.estimate.levels.fit import say_over_budget, store_group
from skinbus.estimate.levels.merge import EVIDENCE
from skinbus.estimate.levels.modes import FEW_READINGS, blend, explore
from skinbus.estimate.levels.profile_likelihood import walk_ridges
from skinbus.estimate.levels.split_merge import (
    ISOLATED,
    clear_owners,
    close_gaps,
    closest_pair,
    copy_rows,
    isolated,
    merge_rows,
    own_nearest,
    rate_contacts,
    recentre,
    remove_row,
    residual_axis,
    residual_peak,
    resize_group,
    split_row,
    start_at,
)
from skinbus.jit import inner_kernel, runtime_int

PENALTY = 25.0
"""chi^2: chance gives 25 to three parameters once in 6e4 cases, and there are some ten places to try."""
DOUBT = 0.03
"""Gains of a few per cent and the shape of a law must not make contacts."""
GROUP_FORCE, GROUP_PLACE = 0.67, 3e-3
"""Slack (log force, m) for what belongs to one group: moves join only contacts that share one."""
SEARCH_SLACK = 0.01
"""Tactels a pitch (m) beyond the contacts are listed: a new contact needs its own."""
SEARCH_ITERATIONS = 25
SPLIT_TURNS = (0.0, 0.5 * math.pi, 0.25 * math.pi, 0.75 * math.pi)
LOOK_AHEAD = 3
SEARCH_ROUNDS = 3
"""Growing and taking back settles in two rounds; a third is for what they left."""
ORPHANS = 4
"""Contacts that a cycle takes up again; one is rare."""
FULL = 2
"""Rank of this level."""
EXPLAINED = 0.15
"""Where noise does not explain what is left, contacts more must leave less than this part of it."""
SPARE_TACTELS = 2
"""Tactels beyond the number of parameters that an answer must also explain, before noise is all it leaves."""
UNLIKE = 0.12
"""Root mean square of what a wrong law leaves, as a part of the pressures: a thumb of 25 mm leaves 9 %."""


@inner_kernel
def select_contacts(lay: Layout, w: Work) -> None:
    """Choose the number of contacts of every group that leaves something to gain."""
    adopt_orphans(lay, w)
    group_contacts(lay, w, GROUP_FORCE, GROUP_PLACE)
    for o in range(rank_groups(w)):
        if w.alive[w.turn[o]]:
            select_group(lay, w, w.turn[o])
    close_gaps(w)


@inner_kernel
def adopt_orphans(lay: Layout, w: Work) -> None:
    """Append a contact at every touched tactel that no contact reaches and that reads too much to be a foot.

    A merge across seams can be one too many; the fit then leaves one contact's tactels for the other's.
    """
    p, laws = w.p, lay.law_par
    for _ in range(ORPHANS):
        n = w.n_contacts[0]
        if n == len(w.s):
            return
        orphan = -1
        for patch in range(len(lay.patch_link)):
            if not w.touched[patch]:
                continue
            link = lay.patch_link[patch]
            surface = surface_of(lay.link, link)
            for i in range(lay.patch_start[patch], lay.patch_start[patch + 1]):
                least = math.sqrt(EVIDENCE) * lay.sigma[i]
                if not w.active[i] or p[i] < least or (orphan >= 0 and p[i] <= p[orphan]):
                    continue
                alone = True
                for c in range(n):
                    if w.link[c] != link:
                        continue
                    d = distance(surface, w.s[c], w.a[c], lay.s[i], lay.a[i])
                    amp, _ = amplitude(laws, lay.law[i], w.log_force[c])
                    top = peak_pressure(laws, lay.law_table, lay.law[i], w.log_force[c])
                    if d < reach(laws, lay.law[i], amp) * w.width[c] or (d < ISOLATED and p[i] < OWNED * top):
                        alone = False
                        break
                if alone:
                    orphan = i
        if orphan < 0:
            return
        law = lay.law[orphan]
        g, h = affine(laws, lay.law_table, law, 0.0)
        w.s[n], w.a[n], w.width[n] = lay.s[orphan], lay.a[orphan], 1.0
        w.log_force[n] = min(max(log_force_of(laws, law, (p[orphan] - h) / g), LOG_FORCE_MIN), LOG_FORCE_MAX)
        w.link[n], w.patch[n] = lay.patch_link[lay.patch[orphan]], lay.patch[orphan]
        w.n_tactels[n], w.level[n], w.quality[n], w.status[n] = 1, 0, 0, 0
        w.residual[n], w.evidence[n] = 0.0, (p[orphan] / lay.sigma[orphan]) ** 2
        w.covariance[n] = 0.0
        w.alive[n] = True
        w.n_contacts[0] = n + 1


@inner_kernel
def select_group(lay: Layout, w: Work, first: int) -> None:
    """Run the moves on one group and write its contacts."""
    link = w.link[first]
    search = runtime_int(SEARCH_ITERATIONS)
    k_before = load_group(w, first)
    if is_over(w):
        say_over_budget(w, k_before)
        return
    k = k_before
    n = list_tactels(lay, w, link, k, 0.0, SEARCH_SLACK, DOUBT)
    add_background(lay, w, link, first, k, n)
    clear_owners(w, n)
    chi2, _, _ = evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
    if k == 1 and chi2 <= PENALTY:
        if w.n_tactels[first] <= FEW_READINGS:
            copy_rows(w.theta, w.best, k)
            settle(lay, w, link, first, k, n)
        w.level[first] = FULL
        return
    own_nearest(lay, w, link, k, n)
    chi2, _, _ = fit(lay, w, link, k, n, MAX_MOVE, search)
    chi2 = widen(lay, w, link, k, n, chi2)
    copy_rows(w.theta, w.best, k)
    k, chi2 = take_back(lay, w, link, k, n, chi2)
    room = min(len(w.theta), k_before + len(w.s) - w.n_contacts[0])
    for _ in range(SEARCH_ROUNDS):
        if chi2 <= max(PENALTY, expected(k, n)) or is_over(w):
            break
        more, chi2_more = look_ahead(lay, w, link, k, room, n, chi2)
        if more == k:
            break
        k, chi2 = take_back(lay, w, link, more, n, chi2_more)

    if k == k_before and is_over(w):  # what level fit has stored is complete, this is not
        say_over_budget(w, k_before)
        return
    resize_group(w, first, k_before, k, link)
    settle(lay, w, link, first, k, n)


@inner_kernel
def settle(lay: Layout, w: Work, link: int, first: int, k: int, n: int) -> None:
    """Fit ``best`` with the law's own weights, look for its rivals, and write the contacts."""
    theta, polish = w.theta, runtime_int(MAX_ITERATIONS)
    copy_rows(w.best, theta, k)
    wide = False
    for c in range(k):
        wide = wide or theta[c, 3] > 1.0
    weigh(lay, w, link, k, n, 0.0)
    own_nearest(lay, w, link, k, n)
    chi2, _, _ = fit(lay, w, link, k, n, MAX_MOVE, polish)
    copy_rows(theta, w.best, k)
    chi2_wide = chi2
    if wide:
        recentre(lay, w, link, k, n)
        own_nearest(lay, w, link, k, n)
        chi2, status, _ = fit(lay, w, link, k, n, MAX_MOVE, polish)
        if status == OFF_SKIN:
            copy_rows(w.best, theta, k)
            chi2 = chi2_wide
    chi2 = explore(lay, w, link, k, n, chi2)
    if chi2 > expected(k, n):
        if wide and chi2_wide < chi2 - WORTH_WIDTH:
            copy_rows(w.best, theta, k)
            chi2 = chi2_wide
            w.n_rivals[0] = 0
        if widen(lay, w, link, k, n, chi2) < chi2:
            w.n_rivals[0] = 0
    n = list_tactels(lay, w, link, k, 0.0, SEARCH_SLACK, 0.0)
    add_background(lay, w, link, first, k, n)
    clear_owners(w, n)
    _, status, _ = fit(lay, w, link, k, n, MAX_MOVE, polish)
    integrated = store_group(lay, w, link, k, n, status, runtime_int(FULL))
    if not integrated and not is_over(w):
        walk_ridges(lay, w, link, k, n)
        stretch(lay, w, link, k, n)
        blend(lay, w, link, k, n)
    if is_over(w):
        say_over_budget(w, k)


@inner_kernel
def worth_more(
    lay: Layout, w: Work, link: int, few: Floats, k_few: int, many: Floats, k_many: int, n: int
) -> bool:
    """Return whether the answer ``many`` is worth its contacts, beside ``few``.

    Only the tactels for which they differ are asked. A richer answer that leaves noise is believed for
    its chi^2. One that leaves more shows that the law is not true here: then it must explain most of what
    the other leaves, and that must be too much for an error of the law.
    """
    predicted, base, listed, weight = w.predicted, w.base, w.list, w.weight
    clear_owners(w, n)
    evaluate(lay, w, link, few, k_few, n, w.normal, w.gradient)
    for t in range(n):
        base[t] = predicted[t]
    evaluate(lay, w, link, many, k_many, n, w.normal, w.gradient)
    chi2_few, chi2_many, asked = 0.0, 0.0, 0
    strict, left, energy = 0.0, 0.0, 0.0
    for t in range(n):
        if (predicted[t] - base[t]) * (predicted[t] - base[t]) * weight[t] < 1.0:
            continue
        i = listed[t]
        asked += 1
        left_few, left_many = w.p[i] - base[t], w.p[i] - predicted[t]
        if w.state[i] == SATURATED:
            left_few, left_many = max(left_few, 0.0), max(left_many, 0.0)
        chi2_few += weight[t] * left_few * left_few
        chi2_many += weight[t] * left_many * left_many
        misfit = lay.law_par[lay.law[i], MISFIT] * w.p[i]
        strict += left_many * left_many / (lay.sigma[i] * lay.sigma[i] + w.doubt[t] + misfit * misfit)
        left += left_few * left_few
        energy += w.p[i] * w.p[i]
    more = k_many - k_few
    freedom = max(asked - 3 * more, 1)
    if chi2_few - chi2_many <= PENALTY * more * max(1.0, chi2_many / freedom):
        return False
    spare = asked - 3 * (more + 1)
    if spare >= SPARE_TACTELS and strict <= spare + GOOD * math.sqrt(2.0 * spare):
        return True
    return chi2_many <= EXPLAINED * chi2_few and left >= UNLIKE * UNLIKE * energy


@inner_kernel
def narrow(lay: Layout, w: Work, link: int, k: int, n: int) -> None:
    """Write ``best`` to ``path``, fitted anew with the law's own width: halves start from there."""
    copy_rows(w.best, w.path, k)
    wide = False
    for c in range(k):
        wide = wide or w.path[c, 3] > 1.0
    if wide:
        copy_rows(w.path, w.theta, k)
        recentre(lay, w, link, k, n)
        own_nearest(lay, w, link, k, n)
        _, status, _ = fit(lay, w, link, k, n, MAX_MOVE, runtime_int(SEARCH_ITERATIONS))
        if status != OFF_SKIN:
            copy_rows(w.theta, w.path, k)


@inner_kernel
def look_ahead(lay: Layout, w: Work, link: int, k: int, room: int, n: int, chi2: float) -> tuple[int, float]:
    """Grow ``best`` by one or two contacts if they are worth it together; return its count and chi^2.

    One alone may not be: two contacts where three are explain little.
    """
    narrow(lay, w, link, k, n)
    for more in range(k + 1, min(k + LOOK_AHEAD, room) + 1):
        if is_over(w):
            break
        chi2_more = grow(lay, w, link, more - 1, n)
        if chi2_more == math.inf:  # every start went off the skin: there is no candidate
            break
        copy_rows(w.candidate, w.path, more)
        copy_rows(w.candidate, w.theta, more)
        chi2_more = widen(lay, w, link, more, n, chi2_more)
        copy_rows(w.theta, w.candidate, more)
        if worth_more(lay, w, link, w.best, k, w.candidate, more, n):
            copy_rows(w.candidate, w.best, more)
            return more, chi2_more
    return k, chi2


@inner_kernel
def take_back(lay: Layout, w: Work, link: int, k: int, n: int, chi2: float) -> tuple[int, float]:
    """Merge the closest pair or drop a contact of ``best`` while that costs less than a contact is worth."""
    theta = w.theta
    while k > 1 and not is_over(w):
        best_chi2 = math.inf
        u, v = closest_pair(lay, w, link, k)
        if isolated(lay, w, link, u, k):  # then all are: each has tactels that no other explains
            break
        copy_rows(w.best, theta, k)
        merge_rows(lay, w, link, u, v)
        remove_row(theta, v, k)
        best_chi2 = try_candidate(lay, w, link, k - 1, n, best_chi2)
        for c in range(k):
            if best_chi2 <= chi2 or is_over(w) or isolated(lay, w, link, c, k):
                continue
            copy_rows(w.best, theta, k)
            remove_row(theta, c, k)
            best_chi2 = try_candidate(lay, w, link, k - 1, n, best_chi2)
        if best_chi2 == math.inf:  # every start went off the skin: there is no candidate
            break
        copy_rows(w.candidate, theta, k - 1)
        best_chi2 = widen(lay, w, link, k - 1, n, best_chi2)
        copy_rows(theta, w.candidate, k - 1)
        if is_over(w) or worth_more(lay, w, link, w.candidate, k - 1, w.best, k, n):
            break
        k -= 1
        chi2 = best_chi2
        copy_rows(w.candidate, w.best, k)
    return k, chi2


@inner_kernel
def grow(lay: Layout, w: Work, link: int, k: int, n: int) -> float:
    """Write the best answer with one contact more than ``path`` to ``candidate``; return its chi^2."""
    theta = w.theta
    best_chi2 = math.inf
    enough = expected(k + 1, n)

    # a contact at the largest residual
    copy_rows(w.path, theta, k)
    clear_owners(w, n)
    evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
    peak = residual_peak(w, n)
    if peak >= 0:
        start_at(lay, w, peak, k)
        best_chi2 = try_candidate(lay, w, link, k + 1, n, best_chi2)
    copy_rows(w.path, theta, k)
    clear_owners(w, n)
    evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
    rate_contacts(lay, w, link, k, n)
    for c in range(k):
        w.badness[c] = w.rate[c]

    # halves of the contact around which the residuals are largest, then of the next
    for _ in range(min(k, 3)):
        worst = runtime_int(0)
        for c in range(1, k):
            if w.badness[c] > w.badness[worst]:
                worst = c
        w.badness[worst] = -1.0
        copy_rows(w.path, theta, k)
        clear_owners(w, n)
        evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
        axis = residual_axis(lay, w, link, worst, n)
        for turn in range(4):
            for size in range(len(SPLIT_OFFSETS)):
                if best_chi2 <= enough or is_over(w):
                    continue
                copy_rows(w.path, theta, k)
                split_row(lay, w, link, worst, k, axis + SPLIT_TURNS[turn], SPLIT_OFFSETS[size])
                best_chi2 = try_candidate(lay, w, link, k + 1, n, best_chi2)
    return best_chi2


@inner_kernel
def try_candidate(lay: Layout, w: Work, link: int, k: int, n: int, best_chi2: float) -> float:
    """Fit ``theta`` and keep it in ``candidate`` if it is the best so far; return the best chi^2."""
    own_nearest(lay, w, link, k, n)
    chi2, status, _ = fit(lay, w, link, k, n, MAX_MOVE, runtime_int(SEARCH_ITERATIONS))
    if status == OFF_SKIN or not chi2 < best_chi2:
        return best_chi2
    copy_rows(w.theta, w.candidate, k)
    return chi2
