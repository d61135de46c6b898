"""A touch that level ``fit`` has not found: a group has one contact more where that is proved.

Two touches near each other may be one cluster, or be merged across a seam. Where the contacts of a group
leave more than they may, on their own tactels or beyond their cores, the group is solved with one more from a
few starts, as level ``full`` does from many. The answer is taken if the contact is proved by the rule of that
level (``worth``), and if the tactels see every contact of it: one far off all tactels explains any reading by
force enough. Else the group stays as it was; it says MISFIT if one was proved.

Failure: two touches nearer than a pitch, and those between boards, stay one contact, which says MISFIT.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.constants import BAD_FIT, MAX_MOVE
from skinbus.estimate.kernels.geometry import distance, surface_of
from skinbus.estimate.kernels.groups import (
    add_background,
    group_contacts,
    list_tactels,
    load_group,
    rank_groups,
)
from skinbus.estimate.kernels.law import peak_pressure
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import MAX_ITERATIONS, OFF_SKIN, ROUGH, evaluate, fit
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.contact_width import expected
from skinbus.estimate.levels.fit import least_worth, needed, say_over_budget, store_group
from skinbus.estimate.levels.growth import (
    SEARCH_ITERATIONS,
    rank_places,
    start_at,
    try_candidate,
)
from skinbus.estimate.levels.learned_size import sizes_explain
from skinbus.estimate.levels.listed_fit import FEWEST, REACHED, fit_listed
from skinbus.estimate.levels.model_selection import SEARCH_SLACK, narrow
from skinbus.estimate.levels.orphans import note_orphans
from skinbus.estimate.levels.split_merge import (
    clear_owners,
    copy_rows,
    own_nearest,
    residual_axis,
    resize_group,
    split_row,
)
from skinbus.estimate.levels.worth import DOUBT, PROVED, reweigh, worth_more
from skinbus.jit import inner_kernel, runtime_int

SEEN = 0.2
"""Part of its peak that a contact must press some tactel with: 9 mm from it. Amid four tactels of 10 mm it is
0.4; further off the force that a reading asks for grows without bound."""
STRONGER = math.log(2.0)
"""log force that a contact may gain as another is put beside it: of two that were one, each has less."""
COMPARABLE = math.log(3.0)
"""log force of the strongest contact beside one that is added over its own, at most: two fingers that were
one are comparable. What a gain, cross-talk or a short leaves of one finger is a third or less."""
HALVES = 0.009
"""m from the middle: halves of what looks like one are two pitches apart at most."""
APART, APART_FEW = 0.010, 0.018
"""m, a pitch: nearer to each other two read like one of another size; and one that fewer than three tactels
feel must have them for itself."""


@inner_kernel
def add_missing(lay: Layout, w: Work) -> None:
    """Add a contact to every group that leaves a touch unexplained, where one is proved."""
    again, n = w.group_again, w.n_contacts[0]
    for c in range(n):
        w.orphan[c] = -1
    note_orphans(lay, w)
    found = False
    for c in range(n):
        again[c] = w.orphan[c] >= 0 or w.quality[c] & BAD_FIT != 0
        found |= again[c]
    if not found:
        return
    group_contacts(lay, w, 0.0, 0.0)
    for c in range(n):
        again[w.group[c]] |= again[c]
    for o in range(rank_groups(w)):
        first = w.turn[o]
        if again[first]:
            k = load_group(w, first)
            if k < len(w.theta) and w.n_contacts[0] < len(w.s):
                add_one(lay, w, first, k)
            if is_over(w):
                say_over_budget(w, k)


@inner_kernel
def add_one(lay: Layout, w: Work, first: int, k: int) -> None:
    """Add a contact to the k of a group, which are in ``theta`` and ``members``, if it is proved."""
    theta, best, link = w.theta, w.best, w.link[first]
    orphan = -1
    for c in range(k):
        i = w.orphan[w.members[c]]
        if i >= 0 and (orphan < 0 or w.p[i] > w.p[orphan]):
            orphan = i
    copy_rows(theta, best, k)
    k_listed = k
    if orphan >= 0:
        w.list[0], w.base[0] = orphan, w.p[orphan]
        start_at(lay, w, runtime_int(0), k)
        copy_rows(theta, w.wide, k + 1)
        k_listed = k + 1
    n = list_tactels(lay, w, link, k_listed, 0.0, SEARCH_SLACK, DOUBT)
    add_background(lay, w, link, first, k_listed, n)
    own_nearest(lay, w, link, k, n)
    chi2, _, _ = fit(lay, w, link, k, n, MAX_MOVE, runtime_int(SEARCH_ITERATIONS), ROUGH, math.inf)
    if chi2 <= expected(k, n):
        return
    copy_rows(theta, best, k)
    if sizes_explain(lay, w, link, k, n):
        return
    reweigh(lay, w, link, best, k, n, chi2)
    narrow(lay, w, link, k, n)
    if search(lay, w, link, k, n, orphan >= 0) == math.inf:
        return
    reweigh(lay, w, link, w.candidate, k + 1, n, 0.0)
    if worth_more(lay, w, link, best, k, w.candidate, k + 1, n) != PROVED:
        return
    for c in range(k):  # one is proved, if not found
        home = w.patch[w.members[c]]
        w.orphan[w.members[c]] = lay.patch_start[home]
    copy_rows(w.candidate, theta, k + 1)
    n, _, status, _ = fit_listed(lay, w, link, first, k + 1, runtime_int(MAX_ITERATIONS))
    if status == OFF_SKIN or is_over(w) or not are_seen(lay, w, link, k):
        return
    weakest, saved = least_worth(lay, w, link, k + 1, n)
    if saved >= needed(lay, w, weakest):
        resize_group(w, first, k, k + 1, link)
        store_group(lay, w, link, k + 1, n, status, runtime_int(1))
        for c in range(k + 1):
            w.orphan[w.members[c]] = -1


@inner_kernel
def search(lay: Layout, w: Work, link: int, k: int, n: int, has_orphan: bool) -> float:
    """Write the best answer found with one contact more than the k of ``path`` to ``candidate``.

    Returns its chi^2, infinity for none. Starts are row k of ``wide``, at a reading beyond all cores, if
    there is one; touched tactels where a contact would explain most; halves of contacts that do not fit.
    """
    theta, path, best_chi2, enough = w.theta, w.path, math.inf, expected(k + 1, n)
    if has_orphan:
        copy_rows(w.wide, theta, k + 1)
        copy_rows(path, theta, k)
        best_chi2 = try_candidate(lay, w, link, k + 1, n, best_chi2)
    copy_rows(path, theta, k)
    clear_owners(w, n)
    evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
    for rank in range(rank_places(lay, w, link, n)):
        if best_chi2 > enough and w.active[w.list[w.match[rank]]] and not is_over(w):
            copy_rows(path, theta, k)
            start_at(lay, w, w.match[rank], k)
            best_chi2 = try_candidate(lay, w, link, k + 1, n, best_chi2)
    for c in range(k):
        if best_chi2 > enough and w.quality[w.members[c]] & BAD_FIT and not is_over(w):
            copy_rows(path, theta, k)
            clear_owners(w, n)
            evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
            split_row(lay, w, link, c, k, residual_axis(lay, w, link, c, n), HALVES)
            best_chi2 = try_candidate(lay, w, link, k + 1, n, best_chi2)
    return math.inf if is_over(w) else best_chi2


@inner_kernel
def are_seen(lay: Layout, w: Work, link: int, k: int) -> bool:
    """Return whether tactels see each contact of ``theta``, as fitted last: the k of ``members``, one more.

    The one more is comparable to the others: far weaker, it would stand for what the law misfits.
    Those that were there before may be seen less, if they have not become much stronger.
    """
    theta, surface = w.theta, surface_of(lay.link, link)
    for c in range(k + 1):
        home, most, reached = w.nearest_tactel[c], 0.0, 0
        if home < 0 or theta[c, 2] > theta[k, 2] + COMPARABLE:
            return False
        for m in range(w.n_felt[c]):
            most = max(most, w.felt[c, m, 3])
            reached += w.felt[c, m, 3] > REACHED * lay.sigma[w.list[w.felt_at[c, m]]]
        peak = peak_pressure(lay.law_par, lay.law_table, lay.law[home], theta[c, 2])
        is_faint = most < SEEN * peak / (theta[c, 3] * theta[c, 3])
        if is_faint and (c == k or theta[c, 2] > w.log_force[w.members[c]] + STRONGER):
            return False
        for e in range(k + 1):
            d = distance(surface, theta[c, 0], theta[c, 1], theta[e, 0], theta[e, 1])
            if e != c and d < (APART_FEW if reached < FEWEST else APART):
                return False
    return True
