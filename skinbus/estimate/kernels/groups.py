"""Groups of contacts that share tactels, and the tactels of a group: what is solved together.

Two contacts belong to one group when their cores overlap, on whatever patches, or when one presses where the
other is with ``HIDDEN`` of the other's own pressure: of a faint contact on a skirt. A group has at most
``TOGETHER`` contacts at first; where more hang together, the closest are joined first. Each group is solved
with the contacts around it held: their pressure, that of their skirts above all, is the background.
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.geometry import develop, distance, is_flat, separation, surface_of, wrap
from skinbus.estimate.kernels.law import (
    MISFIT,
    PROFILED,
    amplitude,
    core,
    misfit_at,
    peak_pressure,
    pressure,
    reach,
    reach_at,
    residual_at,
)
from skinbus.estimate.kernels.layout import Floats, Ints, Layout
from skinbus.estimate.kernels.listed import write_squares
from skinbus.estimate.kernels.workspace import CLEAR, NO_VALUE, OWNED, Work
from skinbus.estimate.levels.kmeans import find_root
from skinbus.jit import inner_kernel
from skinbus.model.bend import bend_at

TOGETHER = 8
"""A normal matrix of 24 x 24; more would not fit a cycle."""
ROUNDS = 3
"""Contacts nearer than 1/3, 2/3 and all of their joint core are joined in this order."""
HIDDEN = 0.25
"""Part of a contact's peak pressure that another one's skirt has there: held, an error of the skirt of a few
per cent, which is usual, would look like the faint contact."""
UNREAD = 10.0
"""Times the largest reading listed, the most that a contact may press between tactels: amid four of a coarse
array they read a tenth of the peak. Without a limit a misfit in proportion to the force makes any readings
likely: those of two fingers as one of 20 kN."""
MOST_HELD = 0.5
"""Part of a reading from which it belongs to the contacts that are held: no other is its owner."""
FORCE_SLACK, PLACE_SLACK = 0.3, 2e-3
"""By so much may a start's force (in log force) and place (m) be wrong, as a rule: K-means errs by 7-18 % and
1-4 mm. Contacts that leave their tactels, or turn out to overlap, are solved again."""


@inner_kernel
def reach_of(lay: Layout, log_force: float, width: float) -> float:
    """Return the longest reach of a contact under any law, m."""
    longest = 0.0
    for law in range(len(lay.law_par)):
        longest = max(longest, reach_at(lay.law_par, law, log_force))
    return longest * width


@inner_kernel
def core_of(lay: Layout, log_force: float, width: float) -> float:
    """Return the largest core of a contact under any law, m."""
    largest = 0.0
    for law in range(len(lay.law_par)):
        largest = max(largest, core(lay.law_par, law, log_force))
    return largest * width


@inner_kernel
def group_contacts(lay: Layout, w: Work, force_slack: float, place_slack: float) -> None:
    """Write to ``group`` the first contact of the group of each contact.

    The slacks, in log force and m, are what contacts may yet grow and move by.
    """
    n = w.n_contacts[0]
    group, size, link, s, a, near_of = w.group, w.group_size, w.link, w.s, w.a, w.contact_near
    widest, furthest = 0.0, 0.0
    for c in range(n):
        group[c], size[c] = c, 1
        w.contact_reach[c] = reach_of(lay, w.log_force[c], w.width[c])
        near_of[c] = core_of(lay, w.log_force[c] + force_slack, w.width[c]) + place_slack
        widest, furthest = max(widest, near_of[c]), max(furthest, w.contact_reach[c])
    order_contacts(w, furthest)
    n_pairs = 0
    for o in range(n):
        c = w.by_s[o]
        k = link[c]
        surface = surface_of(lay.link, k)
        for q in range(o + 1, n if w.alive[c] else 0):
            e = w.by_s[q]
            if link[e] != k or s[e] - s[c] > max(near_of[c] + widest, furthest):
                break
            near = near_of[c] + near_of[e]
            d2, _, _ = separation(surface, s[c], a[c], s[e], a[e])
            d = math.sqrt(d2)
            coupled = d <= near or (d < w.contact_reach[c] and hides(lay, w, c, e, d))
            coupled = coupled or (d < w.contact_reach[e] and hides(lay, w, e, c, d))
            # where each contact has sixteen neighbours, what groups they make is past caring
            if coupled and w.alive[e] and n_pairs < len(w.pair_a):
                w.pair_a[n_pairs], w.pair_b[n_pairs] = c, e
                w.pair_slope[n_pairs] = min(d / near, 1.0)
                n_pairs += 1
    for turn in range(1, ROUNDS + 1):
        for o in range(n_pairs):
            if w.pair_slope[o] * ROUNDS > turn:
                continue
            root, other = find_root(group, w.pair_a[o]), find_root(group, w.pair_b[o])
            if root != other and size[root] + size[other] <= TOGETHER:
                first, second = min(root, other), max(root, other)
                group[second] = first
                size[first] += size[second]
    for c in range(n):
        group[c] = find_root(group, c)


@inner_kernel
def hides(lay: Layout, w: Work, c: int, e: int, d: float) -> bool:
    """Return whether contact c presses at distance d (m) with ``HIDDEN`` of what contact e presses with."""
    found = False
    wide, spread = 1.0 / w.width[c], w.width[e] * w.width[e] / (w.width[c] * w.width[c])
    for law in range(len(lay.law_par)):
        amp, _ = amplitude(lay.law_par, law, w.log_force[c])
        if d < reach(lay.law_par, law, amp) * w.width[c]:
            p = pressure(lay.law_par, lay.law_table, law, amp, d * wide)[0]
            found |= abs(p) * spread > HIDDEN * peak_pressure(lay.law_par, lay.law_table, law, w.log_force[e])
    return found


@inner_kernel
def order_contacts(w: Work, furthest: float) -> None:
    """Write the contacts to ``by_s`` in the order of link and s; none reaches beyond ``furthest`` (m)."""
    order, at, link, s = w.by_s, w.s_before, w.link, w.s
    for c in range(w.n_contacts[0]):
        at[c] = s[c]
        j = c  # contacts come patch by patch, in some such order
        while j > 0 and (
            link[order[j - 1]] > link[c] or (link[order[j - 1]] == link[c] and s[order[j - 1]] > s[c])
        ):
            order[j] = order[j - 1]
            j -= 1
        order[j] = c
    w.n_ordered[0] = w.n_contacts[0]
    w.span[0], w.span[1] = furthest, 0.0


@inner_kernel
def first_from(order: Ints, link_of: Ints, s_of: Floats, n: int, link: int, s: float) -> int:
    """Return the first place in an order of n rows by link and s that is not before (link, s)."""
    first, left = 0, n
    while left > 0:
        half = left // 2
        row = order[first + half]
        is_before = (link_of[row] < link) | ((link_of[row] == link) & (s_of[row] < s))
        first = first + half + 1 if is_before else first
        left = left - half - 1 if is_before else half
    return first


@inner_kernel
def rank_groups(w: Work) -> int:
    """Write the groups to ``turn``, the one that is felt most first; return how many.

    Groups that press on each other depend on which is solved first. That is not to follow from their numbers.
    """
    group, turn, rank = w.group, w.turn, w.rank
    n = 0
    for c in range(w.n_contacts[0]):
        rank[c] = 0.0
        root = group[c]
        rank[root] = max(rank[root], w.evidence[c])
        if root == c:
            turn[n] = c
            n += 1
    for o in range(1, n):
        c = turn[o]
        j = o
        while j > 0 and rank[turn[j - 1]] < rank[c]:
            turn[j] = turn[j - 1]
            j -= 1
        turn[j] = c
    return n


@inner_kernel
def load_group(w: Work, first: int) -> int:
    """Copy the contacts of group ``first`` to ``theta``, note them in ``members``; return how many."""
    group, alive, members, theta = w.group, w.alive, w.members, w.theta
    s, a, log_force = w.s, w.a, w.log_force
    k, left = 0, w.group_size[first]
    for c in range(first, w.n_contacts[0]):
        if group[c] != first:
            continue
        left -= 1
        if alive[c] and k < len(theta):
            theta[k, 0], theta[k, 1], theta[k, 2], theta[k, 3] = s[c], a[c], log_force[c], w.width[c]
            members[k] = c
            k += 1
        if left == 0:
            break
    return k


@inner_kernel
def list_tactels(
    lay: Layout, w: Work, link: int, k: int, force_slack: float, place_slack: float, misfit: float
) -> int:
    """List the tactels that k contacts in ``theta`` may reach; return how many.

    The slacks are those of :func:`group_contacts`, the weights those of :func:`weigh`. Each touched tactel is
    owned by the nearest contact. Writes the distances listed to to ``far_listed``.
    """
    patch_start, patch_link = lay.patch_start, lay.patch_link
    patch_s, patch_a, board, extent = lay.patch_s, lay.patch_a, lay.board, lay.extent
    tactel_s, tactel_a, tactel_narrow = lay.s, lay.a, lay.narrow
    listed, background, owner, state = w.list, w.background, w.owner, w.state
    at_s, at_a, narrow = w.listed_s, w.listed_a, w.listed_narrow
    theta, listed_theta, far, active = w.theta, w.listed_theta, w.far_listed, w.active
    surface = surface_of(lay.link, link)
    for c in range(k):
        far[c] = reach_of(lay, theta[c, 2] + force_slack, theta[c, 3]) + place_slack
        for column in range(4):
            listed_theta[c, column] = theta[c, column]
    top, bottom = -math.inf, math.inf
    for c in range(k):
        top, bottom = max(top, theta[c, 0] + far[c]), min(bottom, theta[c, 0] - far[c])
    near, n_near, n, n_patches = w.order, 0, 0, len(patch_link)
    for o in range(
        first_from(lay.by_s, patch_link, patch_s, n_patches, link, bottom - lay.patch_reach[0]),
        n_patches,
    ):
        patch = lay.by_s[o]
        if patch_link[patch] != link or patch_s[patch] > top + lay.patch_reach[0]:
            break
        is_near = False
        for c in range(k):
            x, y = develop(surface, theta[c, 0], theta[c, 1], patch_a[patch])
            x -= patch_s[patch]
            du = max(abs(board[patch, 0] * x + board[patch, 1] * y) - extent[patch, 0], 0.0)
            dv = max(abs(board[patch, 0] * y - board[patch, 1] * x) - extent[patch, 1], 0.0)
            is_near |= (abs(y) < far[c] + lay.patch_reach[0]) & (du * du + dv * dv < far[c] * far[c])
        near[n_near] = patch  # each is written, and the next in its place unless it is near
        n_near += is_near
    for o in range(n_near):
        patch = near[o]
        for i in range(patch_start[patch], patch_start[patch + 1]):
            nearest, home, inside = math.inf, -1, False
            for c in range(k):
                d2, _, _ = separation(surface, theta[c, 0], theta[c, 1], tactel_s[i], tactel_a[i])
                inside |= d2 < far[c] * far[c]
                home, nearest = c if d2 < nearest else home, min(d2, nearest)
            # each is written, and the next in its place unless it is listed: no branch to be foreseen
            listed[n], background[n], owner[n] = i, 0.0, home if active[i] else -1
            at_s[n], at_a[n], narrow[n] = tactel_s[i], tactel_a[i], tactel_narrow[i]
            n += inside & (state[i] != NO_VALUE)
    weigh(lay, w, link, theta, k, n, misfit)
    clear_weak_owners(lay, w, k, n)
    return n


@inner_kernel
def weigh(lay: Layout, w: Work, link: int, theta: Floats, k: int, n: int, misfit: float) -> None:
    """Give the listed tactels the weights 1 / (sigma^2 + (misfit p)^2), or the law's own misfit if larger.

    A law with a misfit profile adds what it leaves at the distances of the k contacts of ``theta``, as if
    none pressed more than ``UNREAD`` times the largest reading.
    """
    laws, surface = lay.law_par, surface_of(lay.link, link)
    listed, p, weight, doubt, tactel_law = w.list, w.p, w.weight, w.doubt, lay.law
    most, is_profiled = 0.0, False
    for t in range(n):
        i = listed[t]
        most = max(most, p[i])
        is_profiled |= laws[tactel_law[i], PROFILED] != 0.0
        doubt[t] = 0.0
    for c in range(k if is_profiled else 0):
        narrow, last, amp = 1.0 / theta[c, 3], -1, 0.0
        for t in range(n):
            i = listed[t]
            law = tactel_law[i]
            if laws[law, PROFILED] == 0.0:
                continue
            if law != last:
                amp, _ = amplitude(laws, law, theta[c, 2])
                amp, last = min(amp, UNREAD * most / lay.law_table[law, 0, 0]), law
            d = distance(surface, theta[c, 0], theta[c, 1], lay.s[i], lay.a[i])
            wrong = amp * misfit_at(laws, lay.law_table, law, d * narrow) * narrow * narrow
            doubt[t] += wrong * wrong
    for t in range(n):
        i = listed[t]
        sigma, wrong = lay.sigma[i], max(misfit, laws[tactel_law[i], MISFIT]) * p[i]
        weight[t] = 1.0 / (sigma * sigma + doubt[t] + wrong * wrong)


@inner_kernel
def clear_weak_owners(lay: Layout, w: Work, k: int, n: int) -> None:
    """Take from each contact the tactels that read little beside its largest."""
    owner, listed, p, most, sigma = w.owner, w.list, w.p, w.rate, lay.sigma
    for c in range(k):
        most[c] = 0.0
    for t in range(n):  # without branches: which are touched is as good as random
        c = max(owner[t], 0)
        most[c] = max(most[c], p[listed[t]] if owner[t] >= 0 else 0.0)
    for t in range(n):
        i = listed[t]
        is_weak = (p[i] < OWNED * most[max(owner[t], 0)]) & (p[i] < CLEAR * sigma[i])
        owner[t] = -1 if is_weak else owner[t]


@inner_kernel
def add_background(lay: Layout, w: Work, link: int, first: int, k: int, n: int) -> None:
    """Add the pressure of contacts outside group ``first`` to ``background``."""
    theta, far = w.listed_theta, w.far_listed
    top, bottom = -math.inf, math.inf
    for e in range(k):
        top, bottom = max(top, theta[e, 0] + far[e]), min(bottom, theta[e, 0] - far[e])
    slack = w.span[0] + w.span[1]
    n_ordered = w.n_ordered[0]
    by_s, link_of, s_before = w.by_s, w.link, w.s_before
    near, n_near, period = w.near, 0, surface_of(lay.link, link).period
    is_any = k != 1 or not is_flat(lay.link, link)
    for o in range(first_from(by_s, link_of, s_before, n_ordered, link, bottom - slack), n_ordered):
        c = by_s[o]
        if link_of[c] != link or s_before[c] > top + slack:
            break
        most, ds, da = w.contact_reach[c] + far[0], theta[0, 0] - w.s[c], wrap(theta[0, 1] - w.a[c], period)
        near[n_near] = c  # each is written, and the next in its place unless it may be near
        n_near += is_any | ((abs(ds) < most) & (ds * ds + da * da < most * most))
    for o in range(n_near):
        if is_near(lay, w, link, first, k, near[o]):
            add_pressure_of(lay, w, link, n, near[o])
    for c in range(n_ordered, w.n_contacts[0]):  # found since
        if w.link[c] == link and is_near(lay, w, link, first, k, c):
            add_pressure_of(lay, w, link, n, c)
    for t in range(n):
        if w.background[t] > MOST_HELD * w.p[w.list[t]]:
            w.owner[t] = -1


@inner_kernel
def is_near(lay: Layout, w: Work, link: int, first: int, k: int, c: int) -> bool:
    """Return whether contact c is outside group ``first`` and may reach tactels listed for it."""
    surface, theta, furthest = surface_of(lay.link, link), w.listed_theta, w.far_listed
    s, a, reach_of_c, near = w.s[c], w.a[c], w.contact_reach[c], False
    for e in range(k):
        most = reach_of_c + furthest[e]
        if abs(theta[e, 0] - s) < most:
            near |= separation(surface, theta[e, 0], theta[e, 1], s, a)[0] < most * most
    return near and w.group[c] != first and w.alive[c]


@inner_kernel
def add_pressure_of(lay: Layout, w: Work, link: int, n: int, c: int) -> None:
    """Add the pressure of contact c to ``background``."""
    laws, tables, surface = lay.law_par, lay.law_table, surface_of(lay.link, link)
    listed, background, wide = w.list, w.background, w.width[c]
    s, a, narrow, last, amp, most, n_near = w.s[c], w.a[c], 1.0 / wide, -1, 0.0, 0.0, 0
    tactel_law, square, near, at_s, at_a = lay.law, w.square, w.order, w.listed_s, w.listed_a
    is_bent, is_mapped = len(lay.bend) > 0, len(lay.map_step) > 1
    write_squares(lay, w, link, s, a, n)
    for t in range(n):
        law = tactel_law[listed[t]]
        if law != last:
            most, last = reach_at(laws, law, w.log_force[c]) * wide, law
        own = 1.0 if is_bent else w.listed_narrow[t]
        near[n_near] = t
        n_near += (abs(at_s[t] - s) < most) & (is_bent | (square[t] * own * own < most * most))
    last = -1
    for o in range(n_near):
        t = near[o]
        i = listed[t]
        law = tactel_law[i]
        if law != last:
            amp, _ = amplitude(laws, law, w.log_force[c])
            most, last = reach(laws, law, amp) * wide, law
        d2, x, y = separation(surface, s, a, at_s[t], at_a[t])
        own = w.listed_narrow[t]
        if is_bent:
            own *= bend_at(lay.bend, i, x, y)[0]
        if d2 * own * own < most * most:
            p = pressure(laws, tables, law, amp, math.sqrt(d2) * own * narrow)[0]
            if is_mapped and lay.map_of[i] >= 0:
                p += amp * residual_at(lay, i, x, y)[0]
            background[t] += p * narrow * narrow
