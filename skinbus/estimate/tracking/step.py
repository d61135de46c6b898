"""One cycle of the tracker, compiled: carry on, pair up, correct, begin and end tracks.

The order of a cycle is that of :func:`step`. A track and a contact may be paired if they are on one link,
no further apart on the surface than REACH, and within GATE by the covariance of their difference

    C = P + R + (MANOEUVRE dt)^2,     cost = y' inv(C) y + force term + log det C

and the pairs are chosen together at the least total cost. What is left then is paired by distance alone.
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.geometry import distance, surface_of, wrap
from skinbus.estimate.tracking import state as k
from skinbus.estimate.tracking.assignment import assign
from skinbus.estimate.tracking.filter import N, correct, covariance, predict
from skinbus.estimate.tracking.measurements import check_contacts, distance_on, mark_crowded, scale_of_a
from skinbus.estimate.tracking.missed import handle_missed
from skinbus.estimate.tracking.state import Floats, Ground, Ints, TrackWork
from skinbus.jit import inner_kernel, kernel


@kernel
def step(w: TrackWork, g: Ground, t_ns: int, n: int, coast_cycles: int, blind_ns: int, merge_ns: int) -> None:
    """Take the n contacts of a cycle in ``w.c_*``; the tracks are in ``w``."""
    dt = _begin(w, t_ns, blind_ns)
    _predict(w, g, dt)
    check_contacts(w, g, n)
    mark_crowded(w, g, n)
    _associate(w, g, t_ns, n)
    _associate_again(w, g, n)
    handle_missed(w, g, t_ns, n, coast_cycles, merge_ns)
    _update(w, g, t_ns, dt)
    _initiate(w, g, t_ns, n)
    _assign_slots(w)


@inner_kernel
def _begin(w: TrackWork, t_ns: int, blind_ns: int) -> float:
    """Free what was lifted in the last cycle, end what was not seen for too long; return the time step, s."""
    dt_ns = t_ns - w.clock[k.LAST_T] if w.clock[k.STARTED] else 0
    w.clock[k.LAST_T] = t_ns
    w.clock[k.STARTED] = 1
    for i in range(k.MAX_TRACKS):
        if w.identity[i] == 0:
            continue
        if w.state[i] == k.LIFT:
            w.identity[i] = 0
            w.id[i] = 0
            w.state[i] = k.FREE
            if w.slot[i] >= 0:
                w.slot_used[w.slot[i]] = False
                w.slot[i] = -1
            continue
        if dt_ns < 0:  # the clock was set back: everything that was remembered goes with it
            w.born_ns[i] += dt_ns
            w.seen_ns[i] += dt_ns
            w.updated_ns[i] += dt_ns
            w.shown_ns[i] += dt_ns
        w.row[i] = -1
        w.shared[i] = False
        w.missed[i] += 1
        if t_ns - w.seen_ns[i] > blind_ns:
            w.state[i] = k.LIFT
    return 1e-9 * dt_ns if dt_ns > 0 else 0.0


@inner_kernel
def _predict(w: TrackWork, g: Ground, dt: float) -> None:
    """Predict every track to the time of this cycle."""
    for i in range(k.MAX_TRACKS):
        if w.identity[i] == 0 or w.state[i] == k.LIFT or dt == 0.0:
            continue
        scale = scale_of_a(g, w.link[i], w.x[i, 0])
        q_a = k.ACCELERATION / (scale * scale)
        predict(w.x[i], w.U[i], w.D[i], dt, k.ACCELERATION, q_a, k.FORCE_WALK, w.W, w.Dw)
        w.x[i, 1] = wrap(w.x[i, 1], surface_of(g.link, w.link[i]).period)
        covariance(w.U[i], w.D[i], w.P[i])


@inner_kernel
def _associate(w: TrackWork, g: Ground, t_ns: int, n: int) -> None:
    """Choose the pairs of tracks and contacts; ``w.row`` and ``w.c_track`` say them."""
    live, usable, cost, row, c_track = w.live, w.list, w.cost, w.row, w.c_track
    n_tracks = n_contacts = 0
    for i in range(k.MAX_TRACKS):
        if w.identity[i] and w.state[i] != k.LIFT:
            live[n_tracks] = i
            n_tracks += 1
    for j in range(n):
        if w.c_usable[j]:
            usable[n_contacts] = j
            n_contacts += 1
    turned = n_tracks > n_contacts  # the assignment needs at least as many columns as rows
    x, P, z, R, link, c_link = w.x, w.P, w.c_z, w.c_cov, w.link, w.c_link
    for p in range(n_tracks):
        i = live[p]
        slack = min(k.MANOEUVRE * 1e-9 * (t_ns - w.updated_ns[i]), k.MANOEUVRE_MOST)
        m = link[i]
        surface = surface_of(g.link, m)
        scale = scale_of_a(g, m, x[i, 0])
        s, a, force = x[i, 0], x[i, 1], x[i, 4]
        ps, pa, psa, pf = (
            P[i, 0, 0] + slack * slack,
            P[i, 1, 1] + (slack / scale) ** 2,
            P[i, 0, 1],
            P[i, 4, 4],
        )
        hidden = k.COST_HIDDEN if w.hider[i] >= 0 else 0.0
        for q in range(n_contacts):
            j = usable[q]
            price = k.COST_NONE
            ds, da, df = z[j, 0] - s, wrap(z[j, 1] - a, surface.period), z[j, 2] - force
            if c_link[j] == m and abs(ds) <= k.REACH:
                css, caa, csa, cff = ps + R[j, 0, 0], pa + R[j, 1, 1], psa + R[j, 0, 1], pf + R[j, 2, 2]
                det = css * caa - csa * csa
                d2 = (caa * ds * ds - 2.0 * csa * ds * da + css * da * da) / det
                near = distance(surface, s, a, z[j, 0], z[j, 1]) <= k.REACH
                if near and d2 <= k.GATE:
                    price = d2 + min(df * df / cff, k.FORCE_MOST)
                    price += hidden + math.log(det * scale * scale * 1e12)  # square millimetres
                    price = min(price, k.COST_NONE)
            if turned:
                cost[q, p] = price
            else:
                cost[p, q] = price
    assign(cost, min(n_tracks, n_contacts), max(n_tracks, n_contacts), w)
    for r in range(min(n_tracks, n_contacts)):
        c = w.column_of[r]
        if c < 0 or cost[r, c] >= k.COST_NONE:
            continue
        i, j = (live[c], usable[r]) if turned else (live[r], usable[c])
        row[i] = j
        c_track[j] = i


@inner_kernel
def _associate_again(w: TrackWork, g: Ground, n: int) -> None:
    """Pair what is left, the nearest first: where estimates jump, no touch lifts and another begins."""
    left = 0
    for j in range(n):
        left += w.c_usable[j] and w.c_track[j] < 0
    while left:
        track, contact, nearest = -1, -1, k.AGAIN_REACH
        for i in range(k.MAX_TRACKS):
            if w.identity[i] == 0 or w.state[i] == k.LIFT or w.row[i] >= 0:
                continue
            x, raw = w.x[i], w.raw[i]
            for j in range(n):
                if not w.c_usable[j] or w.c_track[j] >= 0 or w.c_link[j] != w.link[i]:
                    continue
                z = w.c_z[j]
                d = distance_on(g, w.link[i], x[0], x[1], z[0], z[1])
                if w.hider[i] < 0:
                    d = min(d, distance_on(g, w.link[i], raw[0], raw[1], z[0], z[1]))
                if d < nearest:
                    track, contact, nearest = i, j, d
        if track < 0:
            return
        w.row[track] = contact
        w.c_track[contact] = track
        w.doubted[track] = True
        left -= 1


@inner_kernel
def _update(w: TrackWork, g: Ground, t_ns: int, dt: float) -> None:
    """Take in what the tracks are seen as; correct the filters of those that share no contact."""
    for i in range(k.MAX_TRACKS):
        if w.identity[i] == 0 or w.row[i] < 0:
            continue
        j, link, x, P = w.row[i], w.link[i], w.x[i], w.P[i]
        for c in range(3):
            w.raw[i, c] = w.c_z[j, c]
        w.patch[i] = w.c_patch[j]
        w.seen_ns[i] = w.shown_ns[i] = t_ns
        w.missed[i] = 0
        w.why[i] = k.SEEN
        if dt > 0.0 and not w.shared[i]:
            _correct(w, i, j, surface_of(g.link, link).period, t_ns)
        scale = scale_of_a(g, link, x[0])
        speed2 = x[2] ** 2 + (scale * x[3]) ** 2
        noise2 = max(P[2, 2], scale * scale * P[3, 3])
        if w.moving[i]:
            w.moving[i] = speed2 > k.SPEED_HELD**2
        else:
            w.moving[i] = speed2 > k.SPEED_MOVE**2 and speed2 > 9.0 * noise2
        w.state[i] = k.MOVE if w.moving[i] else k.HELD


@inner_kernel
def _correct(w: TrackWork, i: int, j: int, period: float, t_ns: int) -> None:
    """Correct the filter of track i by contact j, unless it is the first that is off its line."""
    x, U, D, P, z, Rz, y, R = w.x[i], w.U[i], w.D[i], w.P[i], w.c_z[j], w.c_cov[j], w.y, w.R
    for c in range(3):
        y[c] = z[c] - x[4 if c == 2 else c]
        for d in range(3):
            R[c, d] = Rz[c, d]
    y[1] = wrap(y[1], period)
    css, csa, caa = P[0, 0] + R[0, 0], P[0, 1] + R[0, 1], P[1, 1] + R[1, 1]
    d2 = caa * y[0] ** 2 - 2.0 * csa * y[0] * y[1] + css * y[1] ** 2
    d2 /= css * caa - csa * csa
    if d2 > k.GATE and not w.c_crowded[j]:
        if not w.doubted[i]:  # a contact at a seam may be wrong by more than it says: wait for the next
            w.doubted[i] = True
            return
        for c in range(N):  # a manoeuvre: forget the past in the measure that it was wrong
            D[c] *= d2 / k.GATE
    w.doubted[i] = False
    w.updated_ns[i] = t_ns
    correct(x, U, D, y, R, w.h, w.gain, w.dx)
    x[1] = wrap(x[1], period)
    covariance(U, D, P)


@inner_kernel
def _initiate(w: TrackWork, g: Ground, t_ns: int, n: int) -> None:
    """Begin a track for every contact that has none, the strongest first, as long as there is room."""
    free = 0
    while True:
        best = -1
        for j in range(n):
            if w.c_usable[j] and w.c_track[j] < 0 and (best < 0 or _comes_before(w.c_z, w.c_link, j, best)):
                best = j
        while free < k.MAX_TRACKS and w.identity[free]:
            free += 1
        if best < 0 or free == k.MAX_TRACKS:
            return
        _begin_track(w, free, best, t_ns)


@inner_kernel
def _comes_before(z: Floats, link: Ints, i: int, j: int) -> bool:
    """Return whether contact i begins before contact j: by force, then by place, never by its row."""
    if z[i, 2] != z[j, 2]:
        return bool(z[i, 2] > z[j, 2])
    if link[i] != link[j]:
        return bool(link[i] < link[j])
    if z[i, 0] != z[j, 0]:
        return bool(z[i, 0] < z[j, 0])
    return bool(z[i, 1] < z[j, 1])


@inner_kernel
def _begin_track(w: TrackWork, i: int, j: int, t_ns: int) -> None:
    """Begin a track in row i from contact j."""
    w.clock[k.LAST_IDENTITY] += 1
    w.identity[i] = w.clock[k.LAST_IDENTITY]
    w.id[i] = _next_id(w)
    w.state[i], w.why[i], w.row[i] = k.TOUCH, k.SEEN, j
    w.c_track[j] = i
    w.link[i], w.patch[i] = w.c_link[j], w.c_patch[j]
    w.born_ns[i] = w.seen_ns[i] = w.updated_ns[i] = w.shown_ns[i] = t_ns
    w.doubted[i] = False
    w.missed[i], w.hider[i], w.shared[i], w.moving[i] = 0, -1, False, False
    for c in range(3):
        w.raw[i, c] = w.c_z[j, c]
        w.y[c] = 0.0
        for d in range(3):
            w.R[c, d] = w.c_cov[j, c, d]
    for c in range(N):
        w.x[i, c] = 0.0
        for d in range(N):
            w.U[i, c, d] = 1.0 if c == d else 0.0
    w.x[i, 0], w.x[i, 1], w.x[i, 4] = w.c_z[j, 0], w.c_z[j, 1], w.c_z[j, 2]
    # Nothing is known before the contact: variances far over those of any contact, then the contact itself.
    w.D[i, 0] = w.R[0, 0] * 1e4
    w.D[i, 1] = w.R[1, 1] * 1e4
    w.D[i, 2] = k.SIGMA_SPEED**2
    w.D[i, 3] = k.SIGMA_SPEED**2
    w.D[i, 4] = w.R[2, 2] * 1e4
    correct(w.x[i], w.U[i], w.D[i], w.y, w.R, w.h, w.gain, w.dx)
    covariance(w.U[i], w.D[i], w.P[i])


@inner_kernel
def _next_id(w: TrackWork) -> int:
    """Return the next of 1..255 that no track has; there are fewer tracks than that."""
    while True:
        w.clock[k.LAST_ID] = w.clock[k.LAST_ID] % k.N_IDS + 1
        taken = False
        for i in range(k.MAX_TRACKS):
            taken = taken or w.id[i] == w.clock[k.LAST_ID]
        if not taken:
            return int(w.clock[k.LAST_ID])


@inner_kernel
def _assign_slots(w: TrackWork) -> None:
    """Give free slots to the oldest seen tracks without one; the first word on a track is TOUCH."""
    for slot in range(len(w.slot_used)):
        if w.slot_used[slot]:
            continue
        oldest = -1
        for i in range(k.MAX_TRACKS):
            waits = w.identity[i] and w.slot[i] < 0 and w.row[i] >= 0
            if waits and (oldest < 0 or w.identity[i] < w.identity[oldest]):
                oldest = i
        if oldest < 0:
            return
        w.slot[oldest] = slot
        w.slot_used[slot] = True
        w.state[oldest] = k.TOUCH
