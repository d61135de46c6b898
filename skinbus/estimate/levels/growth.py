"""How an answer grows by one contact: added where the residuals ask for one, or split from another.

The places of additions are those of matching pursuit, at the tactels; splits are along the axis of the
residuals around a contact, and across. Each start is fitted with all contacts of the group.

Failure: a valley that no start crosses.
Source: S. Mallat, Z. Zhang, Matching pursuits with time-frequency dictionaries (1993).
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import DONE, is_nearly_over, is_over
from skinbus.estimate.kernels.constants import MAX_MOVE, SPLIT_OFFSETS
from skinbus.estimate.kernels.geometry import distance, surface_of
from skinbus.estimate.kernels.law import affine, log_force_of, pressure, reach
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import (
    CONVERGED,
    GIVEN_UP,
    LOG_FORCE_MAX,
    LOG_FORCE_MIN,
    OFF_SKIN,
    evaluate,
    fit,
)
from skinbus.estimate.kernels.workspace import Work
from skinbus.estimate.levels.contact_width import expected
from skinbus.estimate.levels.split_merge import (
    clear_owners,
    copy_rows,
    own_nearest,
    rate_contacts,
    remove_row,
    residual_axis,
    split_row,
)
from skinbus.jit import inner_kernel, runtime_int

PEAKS, PEAKS_APART = 3, 0.01
"""Places at which a contact is added, so far apart (m): the first may be what contacts around it leave."""
SEARCH_ITERATIONS = 25
GLANCE, BEHIND = 8, 3.0
"""Iterations after which a start whose chi^2 is so many times that of the best is given up."""
ALIKE = 0.1
"""chi^2 by which an answer that is fitted again, or beaten, may be off: a contact is worth hundreds of it."""
DRAFT = 1
"""Row of ``rival_theta`` with the answer that contacts are exchanged in."""
EXCHANGES = 4
"""Contacts of one answer that are tried elsewhere: those around a missing one."""
NO_BETTER = 0.95
"""Part of chi^2 left by an exchange that has only settled what was there."""
SPLIT_TURNS = (0.0, 0.5 * math.pi, 0.25 * math.pi, 0.75 * math.pi)


@inner_kernel
def exchange(lay: Layout, w: Work, link: int, k: int, n: int) -> float:
    """Improve the k contacts of ``draft``: take one out, fit the others, add one where they leave most.

    Returns chi^2.
    Those around which residuals are largest first; ends where ``EXCHANGES`` of them are no better elsewhere.
    """
    draft, theta, search = w.rival_theta[DRAFT], w.theta, runtime_int(SEARCH_ITERATIONS)
    copy_rows(draft, theta, k)
    own_nearest(lay, w, link, k, n)
    chi2, _, _ = fit(lay, w, link, k, n, MAX_MOVE, search, ALIKE, math.inf)
    copy_rows(theta, draft, k)
    tried = runtime_int(0)  # rows of the draft in which they are
    while tried < min(k, EXCHANGES) and chi2 > expected(k, n) and not is_nearly_over(w):
        copy_rows(draft, theta, k)
        clear_owners(w, n)
        evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
        rate_contacts(lay, w, link, k, n)
        worst = tried
        for c in range(tried + 1, k):
            if w.rate[c] > w.rate[worst]:
                worst = c
        for x in range(4):
            draft[worst, x], draft[tried, x] = draft[tried, x], draft[worst, x]
        copy_rows(draft, theta, k)
        remove_row(theta, tried, k)
        tried += 1
        own_nearest(lay, w, link, k - 1, n)
        _, status, _ = fit(lay, w, link, k - 1, n, MAX_MOVE, search, ALIKE, math.inf)
        if status != OFF_SKIN:
            copy_rows(theta, w.path, k - 1)
            better = grow(lay, w, link, k - 1, n, chi2)
            if better < chi2:
                copy_rows(w.candidate, draft, k)
                tried = runtime_int(0) if better < NO_BETTER * chi2 else tried
                chi2 = better
    return chi2


@inner_kernel
def leave_out(lay: Layout, w: Work, link: int, k: int, n: int) -> bool:
    """Take out of the k contacts of ``draft`` the one that explains least; return whether one can be."""
    best_chi2 = math.inf
    for c in range(k):
        if is_over(w):
            break
        copy_rows(w.rival_theta[DRAFT], w.theta, k)
        remove_row(w.theta, c, k)
        best_chi2 = try_candidate(lay, w, link, k - 1, n, best_chi2)
    copy_rows(w.candidate, w.rival_theta[DRAFT], k - 1)
    return best_chi2 < math.inf


@inner_kernel
def grow(lay: Layout, w: Work, link: int, k: int, n: int, beat: float) -> float:
    """Write the best answer with one contact more than ``path`` to ``candidate``; return its chi^2.

    Returns ``beat`` where none has less.
    """
    theta = w.theta
    best_chi2 = beat
    enough = expected(k + 1, n)

    # a contact where one would explain most of the residuals
    copy_rows(w.path, theta, k)
    clear_owners(w, n)
    evaluate(lay, w, link, theta, k, n, w.normal, w.gradient)
    rate_contacts(lay, w, link, k, n)
    for c in range(k):
        w.badness[c] = w.rate[c]
    for rank in range(rank_places(lay, w, link, n)):
        if best_chi2 <= enough or is_over(w):
            break
        copy_rows(w.path, theta, k)
        start_at(lay, w, w.match[rank], k)
        best_chi2 = try_candidate(lay, w, link, k + 1, n, best_chi2)

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
def rank_places(lay: Layout, w: Work, link: int, n: int) -> int:
    """Write to ``match`` the places in the list at which a contact would explain most; return how many.

    At each tactel that reads more than is predicted, as strong as that. What the others do not explain is
    left in ``base``.
    """
    base, weight, gain, listed = w.base, w.weight, w.pull, w.list
    laws, tables, surface = lay.law_par, lay.law_table, surface_of(lay.link, link)
    for t in range(n):
        base[t] = w.p[listed[t]] - w.predicted[t]
    for t in range(n):
        i = listed[t]
        gain[t] = 0.0
        if base[t] * base[t] * weight[t] < 1.0 or base[t] < 0.0 or is_over(w):
            continue
        law = lay.law[i]
        g, h = affine(laws, tables, law, 0.0)
        amp = (base[t] - h) / g
        far = reach(laws, law, amp)
        top, bottom = 0.0, 0.0
        for u in range(n):
            j = listed[u]
            d = distance(surface, lay.s[i], lay.a[i], lay.s[j], lay.a[j])
            if d < far:
                p, _, _ = pressure(laws, tables, law, amp, d)
                top += weight[u] * p * base[u]
                bottom += weight[u] * p * p
        w.work[DONE] += n
        if top > 0.0:
            gain[t] = top * top / bottom
    for rank in range(PEAKS):
        peak = runtime_int(0)
        for t in range(1, n):
            if gain[t] > gain[peak]:
                peak = t
        if n == 0 or gain[peak] <= 0.0:
            return rank
        w.match[rank] = peak
        i = listed[peak]
        for t in range(n):
            j = listed[t]
            if distance(surface, lay.s[i], lay.a[i], lay.s[j], lay.a[j]) < PEAKS_APART:
                gain[t] = 0.0
    return PEAKS


@inner_kernel
def start_at(lay: Layout, w: Work, t: int, k: int) -> None:
    """Make row k of ``theta`` a contact right at listed tactel t, as strong as what ``base`` leaves there."""
    i = w.list[t]
    law = lay.law[i]
    g, h = affine(lay.law_par, lay.law_table, law, 0.0)
    w.theta[k, 0], w.theta[k, 1], w.theta[k, 3] = lay.s[i], lay.a[i], 1.0
    log_force = log_force_of(lay.law_par, law, (max(w.base[t], lay.sigma[i]) - h) / g)
    w.theta[k, 2] = min(max(log_force, LOG_FORCE_MIN), LOG_FORCE_MAX)


@inner_kernel
def try_candidate(lay: Layout, w: Work, link: int, k: int, n: int, best_chi2: float) -> float:
    """Fit ``theta`` and keep it in ``candidate`` if it is the best so far; return the best chi^2.

    A start that is still far behind after ``GLANCE`` iterations is given up.
    """
    own_nearest(lay, w, link, k, n)
    chi2, status, _ = fit(lay, w, link, k, n, MAX_MOVE, runtime_int(GLANCE), ALIKE, best_chi2 - ALIKE)
    if status == GIVEN_UP or chi2 > BEHIND * best_chi2:
        return best_chi2
    if status != CONVERGED:
        rest = runtime_int(SEARCH_ITERATIONS - GLANCE)
        chi2, status, _ = fit(lay, w, link, k, n, MAX_MOVE, rest, ALIKE, best_chi2 - ALIKE)
    if status == OFF_SKIN or not chi2 < best_chi2:
        return best_chi2
    copy_rows(w.theta, w.candidate, k)
    return chi2
