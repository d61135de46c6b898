"""Groups of contacts whose cores overlap, each solved by a search, the strongest first.

1. Groups whose tactels others press are fitted, without a search: then it is known what each contact presses
   on the tactels of others.
2. All groups are searched.
3. Groups that have come together are joined and searched again.

The search of a group keeps a list of hypotheses and begins with its contacts as they are. It expands the best
hypothesis by the moves until the best one is expanded. Then it expands one rival, at ``full`` and where the
best one misfits; if that yields a better one, it goes on. ``full`` also adds contacts to a hypothesis that
explains the readings. The budget is looked at before each step of a fit.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import DONE, MOST, is_over
from skinbus.estimate.contacts import Quality
from skinbus.estimate.kernels.geometry import are_within, surface_of
from skinbus.estimate.kernels.law import amplitude, core, reach
from skinbus.estimate.kernels.layout import PEAK, Layout
from skinbus.estimate.kernels.workspace import GROUP, NO_VALUE, Search, Work
from skinbus.estimate.search.answer import write_answer
from skinbus.estimate.search.evidence import (
    RIVAL,
    best_of,
    consider,
    describe_hypothesis,
    misfit,
    prepare,
    rescore,
    set_priors,
    top_score,
)
from skinbus.estimate.search.least_squares import ROUGH, copy_contact, fit
from skinbus.estimate.search.model import press, weigh
from skinbus.estimate.search.moves import expand
from skinbus.jit import inner_kernel

ODDS_MOVED = -3.0
"""Log prior odds that boards have offsets: that their zeros have moved since the baseline followed them."""


@inner_kernel
def search_contacts(lay: Layout, w: Work, q: Search, full: bool) -> None:
    """Replace the contacts of the clusters by those of the search, and drop those that are none."""
    for c in range(len(w.alive)):
        w.group[c], w.again[c] = c, w.alive[c]
        if w.alive[c]:
            write_amplitude(lay, w, c)
    for turn in range(3):  # the steps of the module's description
        join_groups(lay, w)
        for c in range(w.n_contacts[0]):
            w.again[c] = w.again[c] or turn == 1
            if w.again[w.group[c]]:
                w.quality[c] |= Quality.OVER_BUDGET.value  # until it is searched
        while not is_over(w):
            first, strongest, waiting = -1, -math.inf, 0
            for c in range(w.n_contacts[0]):
                if w.alive[c] and w.again[w.group[c]]:
                    waiting += w.group[c] == c
                    height = w.amplitude[c] * lay.law_par[law_of(lay, w, c), PEAK]
                    if height > strongest:
                        first, strongest = w.group[c], height
            if first < 0:
                break
            w.again[first] = False
            most = w.work[MOST]
            # the part of this group in the work that is left; what it leaves is for others
            w.work[MOST] = w.work[DONE] + (most - w.work[DONE]) // (waiting if turn > 0 else 1)
            solve_group(lay, w, q, first, turn > 0, full)
            if w.work[MOST] >= 0:  # else the time is over
                w.work[MOST] = most
    for c in range(w.n_contacts[0]):
        if w.alive[c] and w.level[c] == 0:  # no time was left for its group
            # uncertain by a pitch and all of its force
            w.covariance[c] = 0.0
            w.covariance[c, 0, 0] = w.covariance[c, 1, 1] = q.pitch[0] ** 2
            w.covariance[c, 2, 2] = math.exp(2.0 * w.place[c, 2])


@inner_kernel
def law_of(lay: Layout, w: Work, c: int) -> int:
    """Return the law of the patch that feels a contact most."""
    return int(lay.law[lay.patch_start[w.patch[c]]])


@inner_kernel
def write_amplitude(lay: Layout, w: Work, c: int) -> None:
    """Write the amplitude of a contact by its force."""
    w.amplitude[c] = amplitude(lay.law_par, law_of(lay, w, c), w.place[c, 2])[0]


@inner_kernel
def join_groups(lay: Layout, w: Work) -> None:
    """Join groups whose contacts' cores overlap, up to ``GROUP`` contacts; joined groups are solved again."""
    laws, n = lay.law_par, w.n_contacts[0]
    for c in range(n):
        if not w.alive[c]:
            continue
        surface, own = surface_of(lay.link, w.link[c]), core(laws, law_of(lay, w, c), w.amplitude[c])
        for e in range(c):
            if not w.alive[e] or w.link[c] != w.link[e] or w.group[c] == w.group[e]:
                continue
            near = own + core(laws, law_of(lay, w, e), w.amplitude[e])
            if not are_within(surface, near, w.place[c, 0], w.place[c, 1], w.place[e, 0], w.place[e, 1]):
                continue
            old, new, size = max(w.group[c], w.group[e]), min(w.group[c], w.group[e]), 0
            for f in range(n):
                size += w.alive[f] and (w.group[f] == old or w.group[f] == new)
            if size > GROUP:
                continue
            w.again[new] = True
            for f in range(n):
                if w.group[f] == old:
                    w.group[f] = new


@inner_kernel
def list_tactels(lay: Layout, w: Work, q: Search, link: int, k: int) -> None:
    """List the tactels with a value near k contacts of ``theta``, by patch.

    These are all within two pitches of a core, and touched ones within a pitch of the reach of a contact.
    The first k elements of ``scratch`` are then these reaches with a pitch.
    """
    surface, n, near = surface_of(lay.link, link), 0, q.scratch
    for c in range(k):
        law = law_of(lay, w, q.rows[c])
        amp = w.amplitude[q.rows[c]]
        near[c] = reach(lay.law_par, law, amp) + q.pitch[0]
        near[k + c] = min(near[c], core(lay.law_par, law, amp) + 2.0 * q.pitch[0])
    for patch in range(len(lay.patch_link)):
        is_near, s, a = False, lay.patch_s[patch], lay.patch_a[patch]
        for c in range(k if lay.patch_link[patch] == link else 0):
            is_near |= are_within(surface, near[c] + lay.patch_reach[0], q.theta[c, 0], q.theta[c, 1], s, a)
        for i in range(lay.patch_start[patch], lay.patch_start[patch + 1] if is_near else 0):
            inside = False
            for c in range(k if w.state[i] != NO_VALUE else 0):
                far = near[c if w.active[i] else k + c]
                inside |= are_within(surface, far, q.theta[c, 0], q.theta[c, 1], lay.s[i], lay.a[i])
            q.listed[n] = i
            n += inside
    q.n_listed[0] = n


@inner_kernel
def press_from_outside(lay: Layout, w: Work, q: Search, link: int, first: int, k: int) -> bool:
    """Write to ``outside`` what contacts of other groups press; return whether any of it is above noise.

    It is called after :func:`list_tactels`, with the reaches that this has left in ``scratch``.
    """
    surface, near, is_pressed = surface_of(lay.link, link), q.scratch, False
    for t in range(q.n_listed[0]):
        q.outside[t] = 0.0
    for c in range(w.n_contacts[0]):
        if w.alive[c] and w.group[c] != first and w.link[c] == link:
            own, is_beside = reach(lay.law_par, law_of(lay, w, c), w.amplitude[c]), False
            for e in range(k):
                far = own + near[e]
                is_beside |= are_within(
                    surface, far, w.place[c, 0], w.place[c, 1], q.theta[e, 0], q.theta[e, 1]
                )
            if is_beside:
                press(lay, q, link, w.place, c, q.outside, -1)
    for t in range(q.n_listed[0]):
        is_pressed |= q.outside[t] > lay.sigma[q.listed[t]]
    return is_pressed


@inner_kernel
def take_group(w: Work, q: Search, first: int) -> int:
    """Write the contacts of a group to ``theta``, their rows to ``rows``; return their number."""
    k = 0
    for c in range(w.n_contacts[0]):
        if w.alive[c] and w.group[c] == first and k < GROUP:
            copy_contact(w.place[c], q.theta[k])
            q.rows[k] = c
            k += 1
    return k


@inner_kernel
def solve_group(lay: Layout, w: Work, q: Search, first: int, search: bool, full: bool) -> None:
    """Search the contacts of a group and write its answer, or only fit them if others press its tactels.

    Where no contacts explain the readings, the group is searched again with errors that have tails.
    """
    link, k = w.link[first], take_group(w, q, first)
    list_tactels(lay, w, q, link, k)
    if q.n_listed[0] == 0:
        return
    if not (press_from_outside(lay, w, q, link, first, k) or search):
        return
    kind = set_priors(lay, q, law_of(lay, w, q.rows[0]))
    for tailed in range(2):
        k = take_group(w, q, first)
        for c in range(k):
            q.kind[c], q.theta[c, 3] = kind, q.kind_mean[kind]
        q.n_hypotheses[0], q.offsets[0], q.tailed[0] = 0, 0, tailed
        weigh(lay, w, q, link, q.theta, k)
        if not search:
            if math.isfinite(fit(lay, w, q, link, k, ROUGH, -math.inf)[0]):
                for c in range(k):
                    copy_contact(q.theta[c], w.place[q.rows[c]])
                    write_amplitude(lay, w, q.rows[c])
            return
        consider(lay, w, q, link, k)
        if q.n_hypotheses[0] == 0:
            return
        search_group(lay, w, q, link, full)
        if misfit(q, best_of(q)) <= 1.0 or is_over(w):
            break
    write_answer(lay, w, q, link, first, full)
    for c in range(w.n_contacts[0]):
        if w.group[c] == first:
            write_amplitude(lay, w, c)


@inner_kernel
def search_group(lay: Layout, w: Work, q: Search, link: int, full: bool) -> None:
    """Expand the best hypothesis until it is expanded; then, if it misfits or at ``full``, one rival.

    ``weighed`` is the number of contacts that the variances are for, ``since`` the number of rivals expanded
    since the best hypothesis was.
    """
    weighed, since = q.h_count[0], 0
    weigh_offsets(lay, w, q, link)
    while not is_over(w):
        best = best_of(q)
        if q.h_count[best] != weighed:
            rescore(lay, w, q, link, best)
            weighed = q.h_count[best]
        best, h, top = best_of(q), -1, top_score(q) - RIVAL
        for g in range(q.n_hypotheses[0]):
            if not q.h_done[g] and q.h_score[g] > top:
                h, top = g, q.h_score[g]
        since = 0 if h == best else since + 1
        if h < 0 or since > int(full or misfit(q, best) > 1.0):
            break
        q.h_done[h] = True
        expand(lay, w, q, link, h, full)


@inner_kernel
def weigh_offsets(lay: Layout, w: Work, q: Search, link: int) -> None:
    """Make the offsets of boards unknowns if the first hypothesis misfits and offsets explain it."""
    if misfit(q, 0) <= 1.0:
        return
    q.offsets[0] = 1
    score = prepare(lay, w, q, link, 0) + ODDS_MOVED
    if score > q.h_score[0]:
        q.h_score[0] = score
        describe_hypothesis(lay, w, q, 0)
    else:
        q.offsets[0] = 0
