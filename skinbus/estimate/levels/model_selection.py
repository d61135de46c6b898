"""Level ``full``: how many contacts a group has, by penalised likelihood, with moves that change the count.

::

    a contact more is accepted if it lowers chi^2 by more than PENALTY max(1, chi^2 / degrees of freedom)

with the chi^2 of the richer answer on the right, so that a law which does not fit is not compensated by
contacts (``worth``). Moves: merge a pair into one, drop the weakest; grow by one (``growth``), from partial
answers too while they improve; where growth ends short of noise, exchange contacts of the likeliest of those.
Each is followed by a fit of the whole group. For the choice a reading counts with an error of at least
``DOUBT`` of itself, for the answer with what the law claims.

Failure: two contacts nearer than half a pitch look like a larger one; a valley that no move crosses.
Source: G. Schwarz, Estimating the dimension of a model (1978), for the form of the penalty.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_nearly_over, is_over
from skinbus.estimate.kernels.constants import MAX_MOVE
from skinbus.estimate.kernels.covariance import stretch
from skinbus.estimate.kernels.groups import (
    add_background,
    group_contacts,
    list_tactels,
    load_group,
    rank_groups,
    weigh,
)
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import (
    MAX_ITERATIONS,
    OFF_SKIN,
    ROUGH,
    evaluate,
    fit,
)
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.contact_width import WORTH_WIDTH, expected, widen
from skinbus.estimate.levels.fit import say_all_over_budget, say_over_budget, store_group
from skinbus.estimate.levels.growth import DRAFT, SEARCH_ITERATIONS, exchange, grow, leave_out, try_candidate
from skinbus.estimate.levels.learned_size import sizes_explain
from skinbus.estimate.levels.modes import FEW_READINGS, blend, explore
from skinbus.estimate.levels.orphans import adopt_orphans
from skinbus.estimate.levels.posterior import integrate_contacts
from skinbus.estimate.levels.profile_likelihood import walk_ridges
from skinbus.estimate.levels.split_merge import (
    clear_owners,
    close_gaps,
    closest_pair,
    copy_rows,
    isolated,
    merge_rows,
    own_nearest,
    recentre,
    remove_row,
    resize_group,
)
from skinbus.estimate.levels.worth import (
    DOUBT,
    LIKELIER,
    MISSED,
    PENALTY,
    PROVED,
    reweigh,
    to_gain,
    worth_more,
)
from skinbus.jit import inner_kernel, runtime_int

GROUP_FORCE, GROUP_PLACE = 0.67, 3e-3
"""Slack (log force, m) for what belongs to one group: moves join only contacts that share one."""
SEARCH_SLACK = 0.01
"""Tactels a pitch (m) beyond the contacts are listed: a new contact needs its own."""
LOOK_AHEAD = 3
"""Contacts that are added one after the other without paying before growth ends: two where three are explain
little, and what the fourth of five explains the first three distort."""
PAYS = 0.7
"""Part of chi^2 that is left after an addition that pays: one of nine equal touches carries that much."""
SEARCH_ROUNDS = 6
"""Partial answers that growth may go on from."""
FULL = 2
"""Rank of this level."""
MANY = 5
"""Contacts from which on an answer that noise does not explain may have some of them in wrong places."""
REDRAFTS = 3
"""Counts for which contacts are exchanged."""


@inner_kernel
def select_contacts(lay: Layout, w: Work) -> None:
    """Choose the number of contacts of every group that leaves something to gain.

    Groups are made once more of the answers: a contact that was added beside one of another group, half of
    whose tactels it was not given, is solved with it then.
    """
    if is_over(w):
        say_all_over_budget(w, FULL)
        close_gaps(w)
        return
    before, again = w.group_before, w.group_again
    adopt_orphans(lay, w)
    group_contacts(lay, w, GROUP_FORCE, GROUP_PLACE)
    for turn in range(2):
        n = w.n_contacts[0]
        for o in range(rank_groups(w)):
            c = w.turn[o]
            if w.alive[c] and (turn == 0 or again[c]):
                select_group(lay, w, c)
        if turn == 1 or w.n_contacts[0] == n or is_over(w):
            break
        for c in range(w.n_contacts[0]):
            before[c] = w.group[c]
            again[c] = False
        group_contacts(lay, w, GROUP_FORCE, GROUP_PLACE)
        for c in range(w.n_contacts[0]):
            again[w.group[c]] |= w.alive[c] and before[c] != before[w.group[c]]
    close_gaps(w)


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
        if w.n_tactels[first] <= FEW_READINGS and not w.integrated[first]:
            copy_rows(w.theta, w.best, k)
            settle(lay, w, link, first, k, n)
        w.level[first] = FULL
        return
    own_nearest(lay, w, link, k, n)
    chi2, _, _ = fit(lay, w, link, k, n, MAX_MOVE, search, 0.0, math.inf)
    chi2 = widen(lay, w, link, k, n, chi2)
    copy_rows(w.theta, w.best, k)
    k, chi2 = take_back(lay, w, link, k, k, k_before, n, chi2)
    k_base = k
    room = min(len(w.theta), k_before + len(w.s) - w.n_contacts[0])
    explained = chi2 <= max(PENALTY, expected(k, n))
    if not explained and not is_over(w):
        explained = sizes_explain(lay, w, link, k, n)
        chi2 = reweigh(lay, w, link, w.best, k, n, chi2)
    for _ in range(SEARCH_ROUNDS):
        if explained or chi2 <= max(PENALTY, expected(k, n)) or is_over(w):
            break
        more, chi2_more, drafted = look_ahead(lay, w, link, k, room, n, chi2)
        if more == k and drafted >= MANY:
            more, chi2_more = redraft(lay, w, link, k, drafted, room, n, chi2)
        if more == k:
            break
        k_base, k, chi2 = k, more, chi2_more
    if k > k_base:
        k, chi2 = take_back(lay, w, link, k, k_base, k_before, n, chi2)
    if k >= MANY and not is_nearly_over(w):
        copy_rows(w.best, w.rival_theta[DRAFT], k)
        more, chi2 = redraft(lay, w, link, k, k, room, n, chi2)
        if more > k:
            k, chi2 = take_back(lay, w, link, more, k, k_before, n, chi2)

    if is_over(w):  # what level fit has stored is complete, this is not
        say_over_budget(w, k_before)
        return
    resize_group(w, first, k_before, k, link)
    if k == 1 and k_before == 1 and w.integrated[first] and w.best[0, 3] == w.width[first]:
        w.level[first] = FULL  # all modes that one contact has are in its posterior mean
        return
    settle(lay, w, link, first, k, n)


@inner_kernel
def settle(lay: Layout, w: Work, link: int, first: int, k: int, n: int) -> None:
    """Fit ``best`` with the law's own weights, look for its rivals, and write the contacts."""
    theta, polish = w.theta, runtime_int(MAX_ITERATIONS)
    copy_rows(w.best, theta, k)
    wide = False
    for c in range(k):
        wide = wide or theta[c, 3] > 1.0
    weigh(lay, w, link, theta, k, n, 0.0)
    own_nearest(lay, w, link, k, n)
    chi2, _, _ = fit(lay, w, link, k, n, MAX_MOVE, polish, 0.0, math.inf)
    copy_rows(theta, w.best, k)
    chi2_wide = chi2
    if wide and not is_over(w):
        recentre(lay, w, link, k, n)
        own_nearest(lay, w, link, k, n)
        chi2, status, _ = fit(lay, w, link, k, n, MAX_MOVE, polish, 0.0, math.inf)
        if status == OFF_SKIN:
            copy_rows(w.best, theta, k)
            chi2 = chi2_wide
    if not is_over(w):
        chi2 = explore(lay, w, link, k, n, chi2)
    if chi2 > expected(k, n) and not is_over(w):
        if wide and chi2_wide < chi2 - WORTH_WIDTH:
            copy_rows(w.best, theta, k)
            chi2 = chi2_wide
            w.n_rivals[0] = 0
        if widen(lay, w, link, k, n, chi2) < chi2:
            w.n_rivals[0] = 0
    n = list_tactels(lay, w, link, k, 0.0, SEARCH_SLACK, 0.0)
    add_background(lay, w, link, first, k, n)
    clear_owners(w, n)
    _, status, _ = fit(lay, w, link, k, n, MAX_MOVE, polish, 0.0, math.inf)
    integrated = store_group(lay, w, link, k, n, status, runtime_int(FULL))
    if not integrated and not is_over(w):
        walk_ridges(lay, w, link, k, n)
        stretch(lay, w, link, k, n)
        blend(lay, w, link, k, n)
        if k > 1:
            clear_owners(w, n)
            evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
            integrate_contacts(lay, w, link, k, runtime_int(FULL))
    if is_over(w):
        say_over_budget(w, k)


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
        limit = runtime_int(SEARCH_ITERATIONS)
        _, status, _ = fit(lay, w, link, k, n, MAX_MOVE, limit, ROUGH, math.inf)
        if status != OFF_SKIN:
            copy_rows(w.theta, w.path, k)


@inner_kernel
def look_ahead(
    lay: Layout, w: Work, link: int, k: int, room: int, n: int, chi2: float
) -> tuple[int, float, int]:
    """Grow ``best`` by as many contacts as are worth it together; return its count and chi^2.

    One alone may not be: growth goes on from partial answers while they improve. Also returns the count of
    the likeliest of these, which is in ``draft``.
    """
    narrow(lay, w, link, k, n)
    copy_rows(w.path, w.rival_theta[DRAFT], k)
    drafted, cheapest = k, math.inf
    most = to_gain(lay, w, link, k, n)
    least, idle = math.inf, runtime_int(0)  # not that of wide contacts, which growth starts without
    for more in range(k + 1, room + 1):
        if is_over(w) or PENALTY * (more - k) >= most:  # nothing that explains all would be worth them
            break
        chi2_more = grow(lay, w, link, more - 1, n, math.inf)
        if chi2_more == math.inf:  # every start went off the skin: there is no candidate
            break
        idle += 1
        if chi2_more <= PAYS * least:
            least, idle = chi2_more, 0
        copy_rows(w.candidate, w.path, more)
        if more < room and chi2_more + PENALTY * more < cheapest:
            drafted, cheapest = more, chi2_more + PENALTY * more
            copy_rows(w.candidate, w.rival_theta[DRAFT], more)
        if more <= k + LOOK_AHEAD:
            copy_rows(w.candidate, w.theta, more)
            chi2_more = widen(lay, w, link, more, n, chi2_more)
            copy_rows(w.theta, w.candidate, more)
        chi2_more = reweigh(lay, w, link, w.candidate, more, n, chi2_more)
        if worth_more(lay, w, link, w.best, k, w.candidate, more, n) == PROVED:
            copy_rows(w.best, w.rival_theta[0], k)
            copy_rows(w.candidate, w.best, more)
            return more, chi2_more, drafted
        if idle == LOOK_AHEAD:
            break
    return k, reweigh(lay, w, link, w.best, k, n, chi2), drafted


@inner_kernel
def redraft(
    lay: Layout, w: Work, link: int, k: int, drafted: int, room: int, n: int, chi2: float
) -> tuple[int, float]:
    """Exchange contacts of ``draft``; return count and chi^2 of ``best``, which it may become.

    By the law's own weights: with a doubt of the law answers that have a contact in a wrong place look alike.
    A draft that is not proved gets one contact more, or less where it leaves noise.
    """
    draft, more = w.rival_theta[DRAFT], drafted
    for _ in range(REDRAFTS):
        weigh(lay, w, link, draft, more, n, 0.0)
        chi2_more = exchange(lay, w, link, more, n)
        weigh(lay, w, link, draft, more, n, DOUBT)
        if worth_more(lay, w, link, w.best, k, draft, more, n) == PROVED:
            copy_rows(w.best, w.rival_theta[0], k)
            copy_rows(draft, w.best, more)
            clear_owners(w, n)
            return more, evaluate(lay, w, link, draft, more, n, w.normal, w.gradient)[0]
        if is_nearly_over(w):
            break
        weigh(lay, w, link, draft, more, n, 0.0)
        if chi2_more <= expected(more, n):
            if more <= k + 1 or not leave_out(lay, w, link, more, n):
                break
            more -= 1
            continue
        copy_rows(draft, w.path, more)
        if more == room or grow(lay, w, link, more, n, math.inf) == math.inf:
            break
        more += 1
        copy_rows(w.candidate, draft, more)
    weigh(lay, w, link, w.best, k, n, DOUBT)
    return k, chi2


@inner_kernel
def take_back(
    lay: Layout, w: Work, link: int, k: int, k_base: int, k_found: int, n: int, chi2: float
) -> tuple[int, float]:
    """Merge the closest pair or drop a contact of ``best`` while that costs less than a contact is worth.

    Of the ``k_found`` that were found before, none whose touch would be missed then.

    The last growth, from the ``k_base`` contacts in ``rival_theta[0]``, has proved together what it added:
    one of those is taken back only if the others remain proved. All else stays where it is likelier.
    """
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
        if is_over(w):
            break
        worth = worth_more(lay, w, link, w.candidate, k - 1, w.best, k, n)
        if worth == PROVED or (worth == LIKELIER and k - 1 <= k_base):
            break
        if worth == MISSED and k <= k_found:
            break
        if worth == LIKELIER and not base_proves(lay, w, link, k_base, k - 1, n):
            break
        k -= 1
        copy_rows(w.candidate, w.best, k)
        chi2 = reweigh(lay, w, link, w.best, k, n, best_chi2)
    return k, chi2


@inner_kernel
def base_proves(lay: Layout, w: Work, link: int, k_base: int, k: int, n: int) -> bool:
    """Return whether the k contacts of ``candidate`` are proved beside those that growth began with."""
    return worth_more(lay, w, link, w.rival_theta[0], k_base, w.candidate, k, n) == PROVED
