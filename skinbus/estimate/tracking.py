"""Tracks: contacts with an identity over time, a filtered place and force, a velocity, and what they do.

::

             seen                 seen                   unseen too long, or no reason to wait
    ──► TOUCH ──► HELD ◄──► MOVE ──► (any) ──► COAST ─────────────────────────────► LIFT ──► gone
                                       ▲ seen    │
                                       └─────────┘

A track that is not seen in a cycle coasts; it shows where it was last seen. How long it may coast depends on
why it is not seen:

    MISSED   its patch sends readings and they show nothing: a cycle or two
    BLIND    the readings of its patch are missing: until they are back, at most ``blind_s``; or it moves
             through a gap between boards: until it is past that
    HIDDEN   a contact close by is strong enough to be both: two touches that cross; at most a second.

Filter: three independent Kalman filters, of s, a and force. Of a place the acceleration is white::

    x <- [[1, dt], [0, 1]] x,   P <- Phi P Phi' + q [[dt^3/3, dt^2/2], [dt^2/2, dt]]

Association: a track and a contact of one link may be paired within REACH on the surface and within GATE by
the variances C = P + R + (MANOEUVRE dt)^2 of their difference along s and a. The pairs have the least total
cost

    cost = y' inv(C) y + force term + log det C

Pairs beyond the gate but near cost more than all others, by their distance. While a contact is that of two
tracks, neither filter takes it in: both go on as they moved, and their motion distinguishes them when they
part. An estimate at a seam may jump by half a pitch for a cycle: the first contact off the line of a track is
shown, but its filter waits for a second.

Time: steps may be of any length. A contact that was sampled before the time of the cycle is compared with
where its track was then, [1, -age] x. After a gap longer than ``blind_s`` every track ends. A cycle whose
time is that of the last one, or before it, moves identities and raw places on but leaves the filters as they
are.

Limits: on a cone errors and speeds along a are taken as at the middle of the link. Contacts move less than
about 1 m/s, and two that meet keep their speed while they cannot be distinguished, else identities are
exchanged or begin anew, as they are where only one of two that cross is seen for longer than two cycles;
places and forces never change by it. Two touches that turn back within a cycle or two are taken for two that
crossed.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from skinbus.arrays import Bools, Floats, Ints
from skinbus.estimate.columns import record
from skinbus.estimate.contacts import Contacts
from skinbus.estimate.kernels.geometry import LinkSurface, distance, surface_of, wrap
from skinbus.jit import inner_kernel, kernel
from skinbus.model import Arm
from skinbus.model.validation import check_arm, check_fresh, check_time

Rows = npt.NDArray[Any]

MAX_TRACKS = 64
"""Most tracks, and most contacts of a cycle that are looked at (the strongest); the wire shows 16."""
N_IDS = 255
"""Identities on the wire are one byte; 0 is none."""

# --- Measurement -----------------------------------------------------------------------------------
RESUMED, UNKNOWN, LEAST, MOST = np.array(
    [
        [[5e-3, 5e-3, 1.0], [0.0, 0.0, 0.5]],
        [[2e-3, 2e-3, 0.05], [0.0, 0.0, 0.1]],
        [[1e-4, 1e-4, 0.01], [0.0, 0.0, 0.01]],
        [[25e-3, 25e-3, 1.0], [0.0, 0.0, 1.0]],
    ]
)
"""Standard deviations of s, a (m) and force (N), and what is added for each N: of a contact after a restart,
half a pitch; of one without covariance, K-means errs by 1-4 mm and 7-18 %; the least of one with covariance,
a count on the wire; the most, half a patch: a contact is known to be on its patch."""
CROWD = 30e-3
"""Contacts with two tracks this close are crowded, m: their pressures overlap on three pitches."""
SIGMA_CROWD, FORCE_CROWD = 4e-3, 0.5
"""Place error of a crowded contact on top of its covariance, m: the worst of K-means; force error, share of
the force: two that overlap are badly distinguished."""
FAR = np.array([1e3, 1e3, 1e9])
"""s, a (m) and forces (N) beyond these are no contacts."""

# --- Motion ----------------------------------------------------------------------------------------
ACCELERATION = (0.01, 0.01, 0.0)
"""White acceleration of s and a, m^2/s^3: 14 mm/s of change in 20 ms, as of a sliding hand (0.7 m/s^2)."""
WALK = (0.0, 0.0, 100.0)
"""Random walk of the force, N^2/s: 1.4 N in 20 ms."""
SIGMA_SPEED = 0.7
"""Speed of a contact that has just come, m/s: a hand that wipes has 1."""
MANOEUVRE = 0.25
"""Sudden change of speed that keeps an identity, m/s, one sigma; the gate takes four of it."""
MANOEUVRE_MOST = 10e-3
"""Most that this adds to the gate, m, one sigma: the pitch of the tactels."""

# --- Association -----------------------------------------------------------------------------------
GATE = 18.4
"""Largest normalised distance squared: 99.99 % of chi-squared with 2 degrees of freedom."""
FORCE_MOST = 9.0
"""Most that the force adds to the cost: an impact changes the force, never the identity."""
COST_HIDDEN = 19.0
"""What a hidden track pays, over GATE: of two that share a contact the same one shows it all the time."""
COST_AGAIN = 1000.0
"""Cost of a pair by distance alone: far over GATE + FORCE_MOST + COST_HIDDEN + log det, which is at most 57,
so that no such pair takes a contact from one by the gate."""
COST_NONE = 1010.0
"""Cost of leaving a pair apart: over that of any pair, and under that of two by distance alone."""
REACH = 50e-3
"""No pair is further apart than this on the surface, m, whatever the covariance says: one patch."""
AGAIN_REACH = 20e-3
"""A contact that no track expects is that of one which is missed, if it is so near, m: two pitches. Estimates
at seams jump by one, and fingers that lift and touch in turn are further apart."""

# --- Life ------------------------------------------------------------------------------------------
COAST_CYCLES = 2
"""Cycles that a track may miss for no reason."""
MERGE_NS = 1_000_000_000
"""Longest time that a track may be hidden by another contact."""
MERGE_REACH = 40e-3
"""Two contacts closer than this may be seen as one, m: four pitches, where one of them is in a gap."""
MERGE_SHARE = 0.2
"""Share of the hidden contact's force that the common one must show over that of the other."""
GAP = (1.0, 1.6)
"""A place so far from all tactels is in a gap, pitches: nearer ones feel a finger of 2 N; the middle of a
corner of four boards is 1.5 away, and what is further is off the skin."""
SPEED_MOVE = 0.02
"""A contact faster than this moves, m/s, if it is also three sigmas of the speed; ..."""
SPEED_HELD = 0.01
"""... and is held again below this."""

FREE, TOUCH, HELD, LIFT, COAST, MOVE = range(6)


class TrackState(enum.IntEnum):
    """What a track does; the first five are those of the contact TPDO."""

    NONE = FREE
    TOUCH = TOUCH
    """Seen for the first time, or for the first time with a slot."""
    HELD = HELD
    LIFT = LIFT
    """Has ended: said once, then the track is gone."""
    COAST = COAST
    """Not seen in this cycle."""
    MOVE = MOVE


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracks:
    """The tracks of one cycle; every column has n rows, and they stay as they are in later cycles.

    identity    counts from 1 and is never given twice
    id          1..255, of no two tracks at a time
    slot        0..n_slots-1, the same for life; -1 as long as none is free
    state       :class:`TrackState`
    row         row of the contact of this cycle, -1 if it is not seen
    link, patch index of the link, and of the patch that felt it most when last seen
    s, a, force the raw estimate, when last seen; m, m, N
    mean        (n, 5) filtered s, a (m), ds/dt, da/dt (m/s), force (N) at t_ns
    covariance  (n, 3, 3) of s, a and force, which are independent: variance, covariance with the speed,
                variance of the speed
    born_ns     when it was first seen
    seen_ns     when it was last seen
    contact_row (n_contacts,) row in these columns of each contact's track, -1 for none
    """

    t_ns: int
    identity: Ints
    id: Ints
    slot: Ints
    state: Ints
    row: Ints
    link: Ints
    patch: Ints
    s: Floats
    a: Floats
    force: Floats
    mean: Floats
    covariance: Floats
    born_ns: Ints
    seen_ns: Ints
    contact_row: Ints

    def __len__(self) -> int:
        return len(self.identity)


class KeptTrack(NamedTuple):
    """What a restart must not lose of a contact: its identity, and where it was; m, N."""

    identity: int
    id: int
    slot: int
    link: int
    patch: int
    s: float
    a: float
    force: float


TRACK = record(
    {
        "i8": "identity id slot state row link patch born_ns seen_ns updated_ns missed",
        "b1": "doubted shared is_hidden moving",
        "f8": "s a force",
        "(3,2)f8": "mean",
        "(3,3)f8": "covariance",
    }
)
"""A track; its public columns are those of :class:`Tracks`.

mean       s, a and force, each with its speed
updated_ns last time the filter took a contact in
missed     cycles since it was seen
is_hidden  it may be a part of the contact of another track, which is ...
doubted    the last contact was off its line, and not taken in
shared     ... this one
"""
CONTACT = record({"i8": "link patch row track age_ns", "b1": "is_crowded", "3f8": "z r"})
"""A contact of this cycle, its row and the track it went to, -1 for none; z is s, a, force, r their
variances."""
_TIMES = ("born_ns", "seen_ns", "updated_ns")
_PUBLIC = [field.name for field in fields(Tracks) if field.name in set(TRACK.names or ()) - {"mean"}]


class Tracker:
    """Gives the contacts of an arm identities over cycles.

    ``n_slots``  places that can be shown; more tracks than that are kept, up to 64
    ``blind_s``  longest time that a track may be without readings, s

    Everything is compiled when the constructor returns.
    """

    def __init__(self, arm: Arm, *, n_slots: int = 16, blind_s: float = 1.0) -> None:
        check_arm(arm)
        self.arm = arm
        self._slots, self._blind_ns = np.arange(n_slots), round(1e9 * blind_s)
        self._pitch = np.array([placed.patch.pitch for placed in arm.patches])[arm.tactel_patch]
        self._surface = arm.link_shapes
        self._waiting: list[tuple[KeptTrack, int]] = []
        self._first_ns: int | None = None
        self.last = (0, 0)
        """The identity and the number that were given last."""
        self._none = np.zeros(0, CONTACT)
        self.reset()
        self._pair(self._none, 0.0, 0)  # compiled now
        _take(self._tracks, self._none, self._surface, 0.0, 0)

    def reset(self) -> None:
        """Forget all tracks at once, without a word; identities go on counting."""
        self._tracks = np.zeros(0, TRACK)
        self._last_ns: int | None = None

    def kept(self) -> list[KeptTrack]:
        """Return the contacts that are shown, those among them that still wait for their patch."""
        w = self._tracks
        shown = w[(w["slot"] >= 0) & (w["state"] != LIFT)]
        found = [KeptTrack(*row) for row in shown[list(KeptTrack._fields)].tolist()]
        return [*found, *(track for track, _ in self._waiting)]

    def resume(self, track: KeptTrack, within_s: float) -> None:
        """Take up a contact as soon as its patch is read, if that is within this time of the first cycle."""
        self._waiting.append((track, round(1e9 * within_s)))

    def update(
        self,
        contacts: Contacts,
        t_ns: int,
        fresh: npt.ArrayLike | None = None,
        age_ns: npt.ArrayLike = 0,
    ) -> Tracks:
        """Return the tracks after one cycle, those lifted in it included.

        contacts: of this cycle; the strongest 64 are looked at. Rows that are not finite are left out.
        t_ns:     time of the cycle.
        fresh:    (n_patches,) False where readings are missing; None for all there.
        age_ns:   (n_patches,) how long before ``t_ns`` each patch was sampled.

        Raises:
            ValueError: ``fresh`` has the wrong shape.
        """
        t_ns, flags = check_time(t_ns), check_fresh(self.arm, fresh)
        c = self._usable(contacts) if len(contacts) else self._none
        c["age_ns"] = np.broadcast_to(age_ns, flags.shape)[c["patch"]]
        if self._waiting:
            self._take_up(t_ns, flags)
        dt = self._begin(t_ns)
        w, away = self._tracks, self._pair(c, dt, t_ns)
        for k in np.flatnonzero(w["row"] < 0).tolist():
            self._miss(k, c, away, t_ns, flags)
        _take(w, c, self._surface, dt, t_ns)
        self._spawn(t_ns, c)

        shown = self._tracks.copy()
        shown["row"] = np.append(c["row"], -1)[shown["row"]]
        contact_row = np.full(len(contacts), -1, np.int64)
        contact_row[c["row"]] = c["track"]
        mean = shown["mean"][:, [0, 1, 0, 1, 2], [0, 0, 1, 1, 0]]
        columns = {name: shown[name] for name in _PUBLIC}
        return Tracks(t_ns=t_ns, mean=mean, contact_row=contact_row, **columns)

    def _usable(self, contacts: Contacts) -> Rows:
        """Return the contacts that can be used, the strongest first, in whatever order they come."""
        z = np.stack([contacts.s, contacts.a, contacts.force], axis=-1)
        is_usable = (np.abs(z) < FAR).all(axis=1) & (z[:, 2] >= 0.0)  # false for NaN
        order = np.lexsort((z[:, 1], z[:, 0], contacts.link, -z[:, 2]))
        rows = order[is_usable[order]][:MAX_TRACKS]
        c = np.zeros(len(rows), CONTACT)
        c["link"], c["patch"] = contacts.link[rows], contacts.patch[rows]
        c["row"], c["track"], c["z"] = rows, -1, z[rows]
        variance = contacts.covariance[rows].diagonal(axis1=1, axis2=2)
        is_known = ((variance > 0.0) & (variance < np.inf)).all(axis=1, keepdims=True)
        unknown, least, most = (_variance(kind, z[rows, 2:]) for kind in (UNKNOWN, LEAST, MOST))
        c["r"] = np.clip(np.where(is_known, variance, unknown), least, most)
        return c

    def _take_up(self, t_ns: int, fresh: Bools) -> None:
        """Begin the tracks whose patches are read, before the contacts of this cycle are looked at."""
        self._first_ns = t_ns if self._first_ns is None else self._first_ns
        waiting = [entry for entry in self._waiting if t_ns - self._first_ns <= entry[1]]
        self._waiting = [entry for entry in waiting if not fresh[entry[0].patch]]
        for track, _ in waiting:
            w = self._tracks
            is_new = track.identity not in w["identity"] and track.id not in w["id"]
            if fresh[track.patch] and len(w) < MAX_TRACKS and is_new:
                free = np.setdiff1d(self._slots, w["slot"])
                slot = track.slot if track.slot in free else -1
                self._put(track._replace(slot=slot), _variance(RESUMED, track.force), t_ns)

    def _begin(self, t_ns: int) -> float:
        """Leave out what was lifted in the last cycle; return the step, s."""
        dt_ns = 0 if self._last_ns is None else t_ns - self._last_ns
        self._last_ns = t_ns
        w = self._tracks = self._tracks[self._tracks["state"] != LIFT]
        if dt_ns < 0:  # the clock was set back: everything that was remembered goes with it
            for name in _TIMES:
                w[name] += dt_ns
        w["row"], w["shared"] = -1, False
        w["missed"] += 1
        return 1e-9 * max(dt_ns, 0)

    def _pair(self, c: Rows, dt: float, t_ns: int) -> Floats:
        """Carry the tracks on by dt (s) and pair them with contacts; return how far off those are, m."""
        w, shape = self._tracks, (len(self._tracks), len(c))
        away, cost = np.full(shape, np.inf), np.full(shape, COST_NONE)
        _price(w, c, self._surface, away, cost, dt, t_ns, self._blind_ns)
        i, j = linear_sum_assignment(cost)
        is_pair = cost[i, j] < COST_NONE
        i, j = i[is_pair], j[is_pair]
        w["row"][i], c["track"][j] = j, i
        w["doubted"][i] |= cost[i, j] >= COST_AGAIN
        return away

    def _spawn(self, t_ns: int, c: Rows) -> None:
        """Begin a track for contacts that have none, the strongest first; give free slots to the oldest."""
        for j in np.flatnonzero(c["track"] < 0)[: MAX_TRACKS - len(self._tracks)].tolist():
            identity, number = self.last[0] + 1, self.last[1] % N_IDS + 1
            while number in self._tracks["id"]:
                number = number % N_IDS + 1
            self.last = identity, number
            c["track"][j] = len(self._tracks)
            place = (int(c["link"][j]), int(c["patch"][j]), *c["z"][j].tolist())
            self._put(KeptTrack(identity, number, -1, *place), c["r"][j], t_ns - int(c["age_ns"][j]))
            self._tracks["state"][-1], self._tracks["row"][-1] = TOUCH, j
        w = self._tracks
        for i in np.flatnonzero((w["slot"] < 0) & (w["row"] >= 0)).tolist():
            free = np.setdiff1d(self._slots, w["slot"])
            if len(free):
                w["slot"][i], w["state"][i] = free[0], TOUCH

    def _put(self, track: KeptTrack, variance: Floats, t_ns: int) -> None:
        """Begin a track where it was last seen, with variances of s, a and force; its speed is not known."""
        t = np.zeros(1, TRACK)
        for name, value in zip(KeptTrack._fields, track, strict=True):
            t[name] = value
        for name in _TIMES:
            t[name] = t_ns
        t["state"], t["row"] = HELD, -1
        t["mean"][0, :, 0] = track.s, track.a, track.force
        t["covariance"][0, :, 0], t["covariance"][0, :2, 2] = variance, SIGMA_SPEED**2
        self._tracks = np.append(self._tracks, t)

    def _miss(self, i: int, c: Rows, away: Floats, t_ns: int, fresh: Bools) -> None:
        """Decide for a track without a contact why that is, and whether it has ended."""
        w, arm, t = self._tracks, self.arm, self._tracks[i]
        unseen_ns, x = t_ns - t.seen_ns, t["mean"][:, 0]
        if unseen_ns > self._blind_ns:
            t.state = LIFT
            return
        t.is_hidden, t.state = False, COAST
        surface = arm.links[t.link].surface
        # a contact near and strong enough to be that of both; two that meet have both been there before
        j = np.flatnonzero((c["track"] >= 0) & (away[i] <= MERGE_REACH))
        others = w[c["track"][j]]
        is_both = c["z"][j, 2] >= others["mean"][:, 2, 0] + MERGE_SHARE * x[2]
        j = j[is_both & (others["born_ns"] <= t.seen_ns)]
        if len(j) and unseen_ns <= MERGE_NS:
            t.is_hidden = w["shared"][c["track"][j[away[i, j].argmin()]]] = True
            return
        d = surface.distance(arm.tactel_s, arm.tactel_a, x[0], x[1])
        d = np.where(arm.tactel_link == t.link, d, np.inf)
        here = arm.tactel_patch[d.argmin()]
        nearest = (d / self._pitch)[arm.tactel_healthy].min(initial=np.inf)
        is_blind = (t.moving and GAP[0] < nearest <= GAP[1]) or not (fresh[t.patch] and fresh[here])
        if t.missed > COAST_CYCLES and not is_blind:
            t.state = LIFT


def _variance(kind: Floats, force: npt.ArrayLike) -> Floats:
    """Return the variances of s, a and force at forces, N."""
    return np.asarray((kind[0] + kind[1] * force) ** 2)


@kernel
def _price(
    tracks: Rows,
    contacts: Rows,
    surface: Floats,
    away: Floats,
    cost: Floats,
    dt: float,
    t_ns: int,
    longest_ns: int,
) -> None:
    """Carry the tracks on by dt (s); write how far off contacts are, m, and what it costs to pair them."""
    for i in range(len(tracks)):
        t = tracks[i]
        x, on = t["mean"], surface_of(surface, t.link)
        _predict(x, t["covariance"], dt)
        x[1, 0] = wrap(x[1, 0], on.period)
        for j in range(len(contacts)):
            c = contacts[j]
            if c.link == t.link and t_ns - t.seen_ns <= longest_ns:
                age = 1e-9 * c.age_ns
                away[i, j] = distance(on, x[0, 0] - age * x[0, 1], x[1, 0] - age * x[1, 1], c.z[0], c.z[1])
    for j in range(len(contacts)):
        near, c = 0, contacts[j]
        for i in range(len(tracks)):
            near += away[i, j] <= CROWD
        if near > 1:  # errors of contacts that are near others are common, and no covariance says so
            c.is_crowded = True
            c.r[0] += SIGMA_CROWD**2
            c.r[1] += SIGMA_CROWD**2
            c.r[2] += (FORCE_CROWD * c.z[2]) ** 2
        for i in range(len(tracks)):
            if away[i, j] < np.inf:
                cost[i, j] = _pair_cost(tracks[i], c, surface_of(surface, c.link), away[i, j], t_ns)


@kernel
def _take(tracks: Rows, contacts: Rows, surface: Floats, dt: float, t_ns: int) -> None:
    """Take in what tracks are seen as; correct the filters of those that do not share their contact."""
    for i in range(len(tracks)):
        t = tracks[i]
        if t.row < 0:
            continue
        c, x, P = contacts[t.row], t["mean"], t["covariance"]
        t.s, t.a, t.force = c.z[0], c.z[1], c.z[2]
        t.patch, t.missed, t.is_hidden, t.seen_ns = c.patch, 0, False, t_ns - c.age_ns
        if dt > 0.0 and not t.shared:
            _correct(t, c, surface_of(surface, t.link), t_ns)
        noise2 = max(P[0, 2], P[1, 2])
        least2 = SPEED_HELD**2 if t.moving else max(SPEED_MOVE**2, 9.0 * noise2)
        t.moving = x[0, 1] ** 2 + x[1, 1] ** 2 > least2
        t.state = MOVE if t.moving else HELD


@inner_kernel
def _predict(x: Floats, P: Floats, dt: float) -> None:
    """Carry a filter on by dt, s."""
    for k in range(3):
        p, q = P[k], ACCELERATION[k] * dt
        x[k, 0] += dt * x[k, 1]
        p[0] += dt * (2.0 * p[1] + dt * (p[2] + q / 3.0) + WALK[k])
        p[1] += dt * (p[2] + 0.5 * q)
        p[2] += q


@inner_kernel
def _off_line(t: Any, c: Any, on: LinkSurface, slack: float) -> tuple[float, float]:
    """Return the normalised square of how far a contact is off a track, and the determinant, m^4.

    slack: more of a place error, m
    """
    d2, det = 0.0, 1.0
    for k in range(2):
        off, _, _, variance = _seen(t, c, on, k)
        variance += slack * slack
        d2 += off * off / variance
        det *= variance
    return d2, det


@inner_kernel
def _seen(t: Any, c: Any, on: LinkSurface, k: int) -> tuple[float, float, float, float]:
    """Return how far a contact is off a track in s (0), a (1) or force (2) when it was sampled; m, N.

    Then the covariances of the value and its speed with that, and its variance.
    """
    x, p, age = t["mean"][k], t["covariance"][k], 1e-9 * c.age_ns
    off = c.z[k] - x[0] + age * x[1]
    with_value, with_speed = p[0] - age * p[1], p[1] - age * p[2]
    variance = with_value - age * with_speed + c.r[k]
    return wrap(off, on.period) if k == 1 else off, with_value, with_speed, variance


@inner_kernel
def _correct(t: Any, c: Any, on: LinkSurface, t_ns: int) -> None:
    """Correct the filter of a track by a contact, unless it is the first that is off its line."""
    x, P = t["mean"], t["covariance"]
    d2, _ = _off_line(t, c, on, 0.0)
    is_off = d2 > GATE and not c.is_crowded
    if is_off and not t.doubted:  # a contact at a seam may be wrong by more than it says: wait for the next
        t.doubted = True
        return
    t.doubted = False
    t.updated_ns = t_ns
    for k in range(3):
        p = P[k]
        for m in range(3):  # a manoeuvre: forget the past in the measure that it was wrong
            p[m] *= d2 / GATE if is_off else 1.0
        off, with_value, with_speed, variance = _seen(t, c, on, k)
        x[k, 0] += with_value / variance * off
        x[k, 1] += with_speed / variance * off
        p[0] -= with_value * with_value / variance
        p[1] -= with_value * with_speed / variance
        p[2] -= with_speed * with_speed / variance
    x[1, 0] = wrap(x[1, 0], on.period)


@inner_kernel
def _pair_cost(t: Any, c: Any, on: LinkSurface, away: float, t_ns: int) -> float:
    """Return what it costs to take a contact that is so far away (m) for a track, COST_NONE at most."""
    slack = min(MANOEUVRE * 1e-9 * (t_ns - t.updated_ns), MANOEUVRE_MOST)
    d2, det = _off_line(t, c, on, slack)
    if d2 <= GATE and away <= REACH:
        off, _, _, variance = _seen(t, c, on, 2)
        cost = d2 + min(off * off / variance, FORCE_MOST) + math.log(det * 1e12)  # mm^2
        return float(cost + COST_HIDDEN) if t.is_hidden else float(cost)
    if not t.is_hidden:
        away = min(away, distance(on, t.s, t.a, c.z[0], c.z[1]))
    return COST_AGAIN + 100.0 * away if away < AGAIN_REACH else COST_NONE
