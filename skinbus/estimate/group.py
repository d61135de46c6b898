"""Groups of contacts that share tactels, and the tactels of a group: what is solved together.

Two contacts belong to one group when their reaches overlap, on whatever patches. A group has at most
``TOGETHER`` contacts at first; where more hang together, the closest are joined first, and each group is
solved with the contacts around it held (their pressure is the background), twice over.
"""

from __future__ import annotations

import math

from skinbus.estimate.cluster import find_root
from skinbus.estimate.geometry import distance
from skinbus.estimate.kernel import part
from skinbus.estimate.lawkernel import MISFIT, amplitude, pressure, reach
from skinbus.estimate.layout import Layout
from skinbus.estimate.workspace import CLEAR, NO_VALUE, OWNED, Work

TOGETHER = 8
"""A normal matrix of 24 x 24; more would not fit a cycle."""
ROUNDS = 3
"""Contacts nearer than 1/3, 2/3 and all of their joint reach are joined in this order."""
REACH_SLACK, PLACE_SLACK = 0.25, 3e-3
"""A start's reach may be short by a sixth (its force by 40 %), its place wrong by a third of a pitch (m)."""


@part
def group_contacts(lay: Layout, w: Work) -> None:
    """Write to ``group`` the first contact of the group of each contact."""
    n = w.n_contacts[0]
    group, size, link, s, a, far = w.group, w.group_size, w.link, w.s, w.a, w.contact_far
    laws, links = lay.law_par, lay.link
    for c in range(n):
        group[c], size[c] = c, 1
        far[c] = 0.0
        for law in range(len(laws)):
            amp, _ = amplitude(laws, law, w.log_force[c])
            far[c] = max(far[c], reach(laws, law, amp) * w.width[c])
        far[c] += REACH_SLACK * far[c] + PLACE_SLACK
    for turn in range(1, ROUNDS + 1):
        for c in range(n):
            for e in range(c):
                near = turn / ROUNDS * (far[c] + far[e])
                if link[c] != link[e] or abs(s[c] - s[e]) > near:
                    continue
                k = link[c]
                d = distance(links[k, 0], links[k, 1], links[k, 2], links[k, 3], s[c], a[c], s[e], a[e])
                if d > near:
                    continue
                root, other = find_root(group, c), find_root(group, e)
                if root != other and size[root] + size[other] <= TOGETHER:
                    first, second = min(root, other), max(root, other)
                    group[second] = first
                    size[first] += size[second]
    for c in range(n):
        group[c] = find_root(group, c)


@part
def rank_groups(w: Work) -> int:
    """Write the groups to ``turn``, the one that is felt most first; return how many.

    Groups that press on each other depend on who is solved first. That is not to be who has the lower number.
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


@part
def load_group(w: Work, first: int) -> int:
    """Copy the contacts of group ``first`` to ``theta``, note them in ``members``; return how many."""
    group, alive, members, theta = w.group, w.alive, w.members, w.theta
    s, a, log_force = w.s, w.a, w.log_force
    k = 0
    for c in range(first, w.n_contacts[0]):
        if group[c] == first and alive[c] and k < len(theta):
            theta[k, 0], theta[k, 1], theta[k, 2], theta[k, 3] = s[c], a[c], log_force[c], w.width[c]
            members[k] = c
            k += 1
    return k


@part
def list_tactels(lay: Layout, w: Work, link: int, k: int, slack: float, misfit: float) -> int:
    """List the tactels that k contacts in ``theta`` reach, with ``slack`` (m) added; return how many.

    Their weights are those of :func:`weigh`. Each touched one is owned by the nearest contact. Writes the
    distances listed to to ``far_listed``.
    """
    laws, links, patch_start, patch_link = lay.law_par, lay.link, lay.patch_start, lay.patch_link
    patch_s, patch_a, patch_reach = lay.patch_s, lay.patch_a, lay.patch_reach
    tactel_s, tactel_a = lay.s, lay.a
    listed, background, owner, state = w.list, w.background, w.owner, w.state
    theta, listed_theta, far, active = w.theta, w.listed_theta, w.far_listed, w.active
    radius, taper, period, length = links[link, 0], links[link, 1], links[link, 2], links[link, 3]
    for c in range(k):
        far[c] = 0.0
        for law in range(len(laws)):
            amp, _ = amplitude(laws, law, theta[c, 2])
            far[c] = max(far[c], reach(laws, law, amp) * theta[c, 3])
        far[c] += slack
        for x in range(4):
            listed_theta[c, x] = theta[c, x]
    n = 0
    for patch in range(len(patch_link)):
        if patch_link[patch] != link:
            continue
        near = False
        for c in range(k):
            most = far[c] + patch_reach[patch]
            if abs(theta[c, 0] - patch_s[patch]) < most:
                d = distance(
                    radius, taper, period, length, theta[c, 0], theta[c, 1], patch_s[patch], patch_a[patch]
                )
                if d < most:
                    near = True
                    break
        if not near:
            continue
        for i in range(patch_start[patch], patch_start[patch + 1]):
            if state[i] == NO_VALUE:
                continue
            nearest, inside = math.inf, False
            owner[n] = -1
            for c in range(k):
                d = distance(
                    radius, taper, period, length, theta[c, 0], theta[c, 1], tactel_s[i], tactel_a[i]
                )
                if d < far[c]:
                    inside = True
                if d < nearest:
                    nearest = d
                    if active[i]:
                        owner[n] = c
            if inside:
                background[n] = 0.0
                listed[n] = i
                n += 1
    weigh(lay, w, n, misfit)
    disown_weak(lay, w, k, n)
    return n


@part
def weigh(lay: Layout, w: Work, n: int, misfit: float) -> None:
    """Give the listed tactels the weights 1 / (sigma^2 + (misfit p)^2), or the law's own misfit if larger."""
    for t in range(n):
        i = w.list[t]
        wrong = max(misfit, lay.law_par[lay.law[i], MISFIT]) * w.p[i]
        w.weight[t] = 1.0 / (lay.sigma[i] * lay.sigma[i] + wrong * wrong)


@part
def disown_weak(lay: Layout, w: Work, k: int, n: int) -> None:
    """Take from each contact the tactels that read little beside its largest."""
    owner, listed, p, most, sigma = w.owner, w.list, w.p, w.rate, lay.sigma
    for c in range(k):
        most[c] = 0.0
    for t in range(n):
        if owner[t] >= 0:
            most[owner[t]] = max(most[owner[t]], p[listed[t]])
    for t in range(n):
        i = listed[t]
        if owner[t] >= 0 and p[i] < OWNED * most[owner[t]] and p[i] < CLEAR * sigma[i]:
            owner[t] = -1


@part
def add_background(lay: Layout, w: Work, link: int, first: int, k: int, n: int) -> bool:
    """Add the pressure of contacts outside group ``first`` to ``background``; return whether there is any."""
    laws, tables, links = lay.law_par, lay.law_table, lay.link
    group, alive, contact_link, far = w.group, w.alive, w.link, w.far_listed
    listed, background, theta = w.list, w.background, w.listed_theta
    radius, taper, period, length = links[link, 0], links[link, 1], links[link, 2], links[link, 3]
    found = False
    for c in range(w.n_contacts[0]):
        if group[c] == first or not alive[c] or contact_link[c] != link:
            continue
        near = False
        for e in range(k):
            if abs(theta[e, 0] - w.s[c]) < w.contact_far[c] + far[e]:
                near = True
                break
        if not near:
            continue
        for law in range(len(laws)):
            amp, _ = amplitude(laws, law, w.log_force[c])
            wide = w.width[c]
            most = reach(laws, law, amp) * wide
            for t in range(n):
                i = listed[t]
                if lay.law[i] != law or abs(lay.s[i] - w.s[c]) >= most:
                    continue
                d = distance(radius, taper, period, length, w.s[c], w.a[c], lay.s[i], lay.a[i])
                if d < most:
                    background[t] += pressure(laws, tables, law, amp, d / wide)[0] / (wide * wide)
                    found = True
    return found
