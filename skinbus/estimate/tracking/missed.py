"""Tracks without a contact in a cycle: why that is, and whether they have ended.

A track is hidden while a contact nearby is strong enough to be that of two. A weaker one hides it for a while
too, if its law does not explain the readings or if the two move against each other: one contact that is
fitted to two touches may have the force of one.
"""

from __future__ import annotations

import numpy as np

from skinbus.estimate.kernels.constants import BAD_FIT
from skinbus.estimate.kernels.geometry import surface_of, wrap
from skinbus.estimate.tracking import state as k
from skinbus.estimate.tracking.measurements import distance_on, scale_of_a
from skinbus.estimate.tracking.state import Floats, Ground, TrackWork
from skinbus.jit import inner_kernel


@inner_kernel
def handle_missed(w: TrackWork, g: Ground, t_ns: int, n: int, coast_cycles: int, merge_ns: int) -> None:
    """Decide for every track without a contact why that is, and whether it has ended."""
    for i in range(k.MAX_TRACKS):
        if w.identity[i] == 0 or w.state[i] == k.LIFT or w.row[i] >= 0:
            w.hider[i] = -1
            continue
        w.state[i] = k.COAST
        hider = -1
        if t_ns - w.seen_ns[i] <= merge_ns:
            hider = _hider(w, g, i, n, t_ns)
        w.hider[i] = hider
        if hider >= 0:
            w.why[i] = k.HIDDEN
            w.shared[hider] = True
            if w.shown_ns[i] == t_ns:  # its contact is that of both
                shown = w.c_z[w.row[hider]]
                _stay_near(g, w.link[i], w.x[i], shown)
                _stay_near(g, w.link[i], w.x[hider], shown)
        elif _is_blind(w, g, i):
            w.why[i] = k.BLIND
        else:
            w.why[i] = k.MISSED
            if w.missed[i] > coast_cycles:
                w.state[i] = k.LIFT


@inner_kernel
def _hider(w: TrackWork, g: Ground, i: int, n: int, t_ns: int) -> int:
    """Return the track whose contact is near and strong enough to be that of track i too, -1 for none."""
    before, link, x, z, c_track = w.hider[i], w.link, w.x, w.c_z, w.c_track
    lately = t_ns - w.shown_ns[i] <= k.WEAK_NS
    best, nearest, best_strong = -1, k.MERGE_REACH, False
    for j in range(n):
        other = c_track[j]
        if other < 0 or link[other] != link[i] or w.born_ns[other] > w.seen_ns[i]:
            continue  # two that meet have both been there before
        share = k.MERGE_LEAVE if other == before else k.MERGE_ENTER
        strong = z[j, 2] >= x[other, 4] + share * x[i, 4]
        if not strong and not (lately and (w.c_quality[j] & BAD_FIT or _pass(w, g, i, other))):
            continue
        d = distance_on(g, link[i], x[i, 0], x[i, 1], z[j, 0], z[j, 1])
        if d <= nearest:
            best, nearest, best_strong = other, d, strong
    if best_strong:
        w.shown_ns[i] = t_ns
    return best


@inner_kernel
def _pass(w: TrackWork, g: Ground, i: int, other: int) -> bool:
    """Return whether two tracks move against each other: they meet now, and part again."""
    if not w.moving[i] and not w.moving[other]:
        return False
    scale = scale_of_a(g, w.link[i], w.x[i, 0])
    vs, va = w.x[i, 2] - w.x[other, 2], scale * (w.x[i, 3] - w.x[other, 3])
    return bool(vs * vs + va * va > k.SPEED_MOVE**2)


@inner_kernel
def _stay_near(g: Ground, link: int, x: Floats, z: Floats) -> None:
    """Bring a track that shares contact z back to where it can be: it goes on, but not out of the contact."""
    d = distance_on(g, link, x[0], x[1], z[0], z[1])
    if d > k.MERGE_STAY:
        share = k.MERGE_STAY / d
        x[0] = z[0] + share * (x[0] - z[0])
        period = surface_of(g.link, link).period
        x[1] = wrap(z[1] + share * wrap(x[1] - z[1], period), period)


@inner_kernel
def _is_blind(w: TrackWork, g: Ground, i: int) -> bool:
    """Return whether there are no readings where track i was or is, or it moves through a gap."""
    if not w.fresh[w.patch[i]] or not w.fresh[_patch_at(g, w.link[i], w.x[i])]:
        return True
    return bool(w.moving[i] and _is_in_gap(g, w.link[i], w.x[i]))


@inner_kernel
def _patch_at(g: Ground, link: int, x: Floats) -> int:
    """Return the patch whose centre is nearest to a place on a link; patch 0 where the link has none."""
    best, nearest = 0, np.inf
    for p in range(len(g.patch_s)):
        if g.patch_link[p] == link:
            d = distance_on(g, link, g.patch_s[p], g.patch_a[p], x[0], x[1])
            if d < nearest:
                best, nearest = p, d
    return best


@inner_kernel
def _is_in_gap(g: Ground, link: int, x: Floats) -> bool:
    """Return whether a place is between boards, where no tactel may feel it."""
    nearest = np.inf
    for j in range(len(g.tactel)):
        pitch = g.tactel[j, 3]
        if g.tactel[j, 0] == link and abs(g.tactel[j, 1] - x[0]) <= min(nearest, k.GAP[1]) * pitch:
            d = distance_on(g, link, g.tactel[j, 1], g.tactel[j, 2], x[0], x[1]) / pitch
            if d <= k.GAP[0]:
                return False
            nearest = min(nearest, d)
    return bool(nearest <= k.GAP[1])
