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
    HIDDEN   a contact close by is strong enough to be both: two touches that cross; at most ``merge_s``.
             Or too weak, but one that its law does not explain, or of a touch that it moves against: 0.15 s

Filter: three independent Kalman filters, of s, a and force. Of a place the acceleration is white::

    x <- [[1, dt], [0, 1]] x,   P <- Phi P Phi' + q [[dt^3/3, dt^2/2], [dt^2/2, dt]]

Association: a track and a contact of one link may be paired within REACH on the surface and within GATE by
the covariance C = P + R + (MANOEUVRE dt)^2 of their difference. The pairs have the least total cost

    cost = y' inv(C) y + force term + log det C

Pairs beyond the gate but near cost more than all others, by their distance. While a contact is that of two
tracks, neither filter takes it in: both go on as they moved, and their motion distinguishes them when they
part. An estimate at a seam may jump by half a pitch for a cycle: the first contact off the line of a track is
shown, but its filter waits for a second.

Time: steps may be of any length. After a gap longer than ``blind_s`` every track ends. A cycle whose time is
that of the last one, or before it, moves identities and raw places on but leaves the filters as they are.

Limits: contacts move less than about 1 m/s, and two that meet keep their speed while they cannot be
distinguished, else identities are exchanged or begin anew; places and forces never change by it. Two touches
that turn back within a cycle or two are taken for two that crossed (``python -m tests.estimate.crossing``).
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, fields
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from skinbus.estimate.contacts import Contacts
from skinbus.estimate.kernels.constants import BAD_FIT
from skinbus.estimate.kernels.geometry import LinkSurface, distance, surface_of, wrap
from skinbus.estimate.validation import check_arm, check_time
from skinbus.jit import inner_kernel, kernel
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Rows = npt.NDArray[Any]

MAX_TRACKS: Final = 64
"""Most tracks, and most contacts of a cycle that are looked at (the strongest); the wire shows 16."""
N_IDS: Final = 255
"""Identities on the wire are one byte; 0 is none."""
RESUMED_M: Final = 5e-3
"""Where a contact may be after a restart, one standard deviation, m: half a pitch."""

# --- Measurement -----------------------------------------------------------------------------------
SIGMA_UNKNOWN: Final = 2e-3
"""Place error of a contact without covariance, m: K-means errs by 1-4 mm."""
FORCE_UNKNOWN: Final = 0.1
"""Its force error, share of the force: K-means errs by 7-18 %."""
SIGMA_FLOOR: Final = 1e-4
"""Least place error of a contact with covariance, m: one count on the wire."""
FORCE_FLOOR: Final = 0.01
"""Its least force error, share of the force, and N."""
SIGMA_CEILING: Final = 25e-3
"""Most place error, m: half a patch; a contact is known to be on its patch."""
CROWD: Final = 30e-3
"""Contacts with two tracks this close are crowded, m: their pressures overlap on three pitches."""
SIGMA_CROWD: Final = 4e-3
"""Place error of a crowded contact on top of its covariance, m: the worst of K-means."""
FORCE_CROWD: Final = 0.5
"""Its force error, share of the force: two that overlap are badly distinguished."""
CORRELATION_MOST: Final = 0.99
"""Correlations are limited to this: what rounding has made singular is regular again."""
FAR: Final = 1e3
"""Places (m) and forces (times 1e6, N) beyond this are no contacts."""

# --- Motion ----------------------------------------------------------------------------------------
ACCELERATION: Final = 0.01
"""White acceleration, m^2/s^3: 14 mm/s of change in 20 ms, what a sliding hand does (0.7 m/s^2)."""
FORCE_WALK: Final = 100.0
"""Random walk of the force, N^2/s: 1.4 N in 20 ms."""
SIGMA_SPEED: Final = 0.7
"""Speed of a contact that has just come, m/s: a hand that wipes has 1."""
MANOEUVRE: Final = 0.25
"""Sudden change of speed that keeps an identity, m/s, one sigma; the gate takes four of it."""
MANOEUVRE_MOST: Final = 10e-3
"""Most that this adds to the gate, m, one sigma: the pitch of the tactels."""

# --- Association -----------------------------------------------------------------------------------
GATE: Final = 18.4
"""Largest normalised distance squared: 99.99 % of chi-squared with 2 degrees of freedom."""
FORCE_MOST: Final = 9.0
"""Most that the force adds to the cost: an impact changes the force, never the identity."""
COST_HIDDEN: Final = 19.0
"""What a hidden track pays, over GATE: of two that share a contact the same one shows it all the time."""
COST_AGAIN: Final = 1000.0
"""Cost of a pair by distance alone: far over GATE + FORCE_MOST + COST_HIDDEN + log det, which is at most 57,
so that no such pair takes a contact from one by the gate."""
COST_NONE: Final = 1010.0
"""Cost of leaving a pair apart: over that of any pair, and under that of two by distance alone."""
REACH: Final = 50e-3
"""No pair is further apart than this on the surface, m, whatever the covariance says: one patch."""
AGAIN_REACH: Final = 20e-3
"""A contact that no track expects is that of one which is missed, if it is so near, m: two pitches. Estimates
at seams jump by one, and fingers that lift and touch in turn are further apart."""

# --- Life ------------------------------------------------------------------------------------------
MERGE_REACH: Final = 40e-3
"""Two contacts closer than this may be seen as one, m: four pitches, where one of them is in a gap."""
MERGE_STAY: Final = 20e-3
"""Tracks that share a contact are no further from it, m: two that are seen as one are mostly closer, and
speeds before a merger are not known so well that they last."""
MERGE_ENTER: Final = 0.3
"""Share of the hidden contact's force that the common one must show over that of the other."""
MERGE_LEAVE: Final = 0.1
"""The same once it is hidden: below this it has gone."""
WEAK_NS: Final = 150_000_000
"""A contact that is too weak to be both hides a touch for so long: touches that pass at 0.1 m/s each have
moved three pitches by then."""
GAP: Final = (1.0, 1.6)
"""A place so far from all tactels is in a gap, pitches: nearer ones feel a finger of 2 N; the middle of a
corner of four boards is 1.5 away, and what is further is off the skin."""
SPEED_MOVE: Final = 0.02
"""A contact faster than this moves, m/s, if it is also three sigmas of the speed; ..."""
SPEED_HELD: Final = 0.01
"""... and is held again below this."""
SCALE_LEAST: Final = 0.05
"""Least scale of a on a cone, towards its tip: a stays an arc length that can be divided by."""

FREE, TOUCH, HELD, LIFT, COAST, MOVE = range(6)
SEEN, MISSED, BLIND, HIDDEN = range(4)


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


class Unseen(enum.IntEnum):
    """Why a track coasts or has ended."""

    SEEN = SEEN
    MISSED = MISSED
    BLIND = BLIND
    HIDDEN = HIDDEN


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracks:
    """The tracks of one cycle; every column has n rows, and they stay as they are in later cycles.

    identity    counts from 1 and is never given twice
    id          1..255, of no two tracks at a time
    slot        0..n_slots-1, the same for life; -1 as long as none is free
    state       :class:`TrackState`
    why         :class:`Unseen`
    row         row of the contact of this cycle, -1 if it is not seen
    link, patch index of the link, and of the patch that felt it most when last seen
    s, a, force the raw estimate, when last seen; m, m, N
    mean        (n, 5) filtered s, a (m), ds/dt, da/dt (m/s), force (N) at t_ns
    covariance  (n, 5, 5) of mean, symmetric and positive definite
    born_ns     when it was first seen
    seen_ns     when it was last seen
    contact_row (n_contacts,) row in these columns of each contact's track, -1 for none
    """

    t_ns: int
    identity: Ints
    id: Ints
    slot: Ints
    state: Ints
    why: Ints
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


TRACK: Final = np.dtype(
    [
        *((name, "i8") for name in ("identity", "id", "slot", "state", "why", "row", "link", "patch")),
        *((name, "i8") for name in ("born_ns", "seen_ns", "updated_ns", "shown_ns", "missed", "hider")),
        *((name, "?") for name in ("doubted", "shared", "moving")),
        *((name, "f8") for name in ("s", "a", "force")),
        ("mean", "f8", 5),
        ("covariance", "f8", (5, 5)),
    ],
    align=True,
)
"""A track; its public columns are those of :class:`Tracks`.

identity   0 where the row is free
updated_ns last time the filter took a contact in
shown_ns   last time it was seen, or a contact was strong enough to be its too
missed     cycles since it was seen
hider      track whose contact hides it, -1 for none
doubted    the last contact was off its line, and not taken in
shared     its contact is that of hidden tracks too
"""
CONTACT: Final = np.dtype(
    [
        *((name, "i8") for name in ("link", "patch", "quality", "track")),
        *((name, "?") for name in ("usable", "crowded")),
        ("z", "f8", 3),
        ("R", "f8", (3, 3)),
    ],
    align=True,
)
"""A contact of this cycle: s, a, force and their covariance; the track it went to, -1 for none."""
_PLACE: Final = ["s", "a", "force"]
_PUBLIC: Final = [field.name for field in fields(Tracks) if field.name in (TRACK.names or ())]


class Tracker:
    """Gives the contacts of an arm identities over cycles.

    ``n_slots``       places that can be shown; more tracks than that are kept, up to 64
    ``coast_cycles``  cycles that a track may miss for no reason
    ``blind_s``       longest time that it may be without readings, s
    ``merge_s``       longest time that it may be hidden by another contact, s

    Everything is compiled and allocated when the constructor returns.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        n_slots: int = 16,
        coast_cycles: int = 2,
        blind_s: float = 1.0,
        merge_s: float = 1.0,
    ) -> None:
        check_arm(arm)
        if not 1 <= n_slots <= MAX_TRACKS:
            raise ValueError(f"n_slots must be 1..{MAX_TRACKS}, got {n_slots}")
        if coast_cycles < 0 or not 0.0 < merge_s <= blind_s < 3600.0:
            raise ValueError(
                f"wanted coast_cycles >= 0 and 0 < merge_s <= blind_s < 3600; "
                f"got {coast_cycles}, {merge_s}, {blind_s}"
            )
        self.arm = arm
        self._n_slots = n_slots
        self._coast_cycles = coast_cycles
        self._blind_ns = round(1e9 * blind_s)
        self._merge_ns = round(1e9 * merge_s)
        self._pitch = np.array([placed.patch.pitch for placed in arm.patches])[arm.tactel_patch]
        surface = [arm.link_radius, arm.link_taper, arm.link_period, arm.link_length]
        self._surface = np.stack(surface, -1)
        self._contacts = np.zeros(MAX_TRACKS, CONTACT)
        self._away, self._cost = np.full((2, MAX_TRACKS, MAX_TRACKS), np.inf)
        self._waiting: list[tuple[KeptTrack, int]] = []
        self._first_ns: int | None = None
        self._last = (0, 0)
        self.reset()
        self._price(0, 0.0, 0)  # compiled now
        _take(self._tracks, self._contacts, self._surface, 0.0, 0)

    def reset(self) -> None:
        """Forget all tracks at once, without a word; identities go on counting."""
        self._tracks = np.zeros(MAX_TRACKS, TRACK)
        for name in ("slot", "row", "hider"):
            self._tracks[name] = -1
        self._last_ns: int | None = None

    def kept(self) -> list[KeptTrack]:
        """Return the contacts that are shown, those among them that still wait for their patch."""
        w = self._tracks
        shown = w[(w["identity"] != 0) & (w["slot"] >= 0) & (w["state"] != LIFT)]
        found = [KeptTrack(*row) for row in shown[list(KeptTrack._fields)].tolist()]
        return [*found, *(track for track, _ in self._waiting)]

    def last(self) -> tuple[int, int]:
        """Return the identity and the number that were given last."""
        return self._last

    def resume(self, track: KeptTrack, within_s: float) -> None:
        """Take up a contact as soon as its patch is read, if that is within this time of the first cycle."""
        self._waiting.append((track, round(1e9 * within_s)))

    def resume_counts(self, identity: int, number: int) -> None:
        """Go on counting identities and numbers after those that were given last."""
        self._last = max(self._last[0], identity), number % (N_IDS + 1)

    def update(self, contacts: Contacts, t_ns: int, fresh: npt.ArrayLike | None = None) -> Tracks:
        """Return the tracks after one cycle, those lifted in it included.

        contacts: of this cycle; the strongest 64 are looked at. Rows that are not finite are left out.
        t_ns:     time of the cycle.
        fresh:    (n_patches,) False where readings are missing; None for all there.

        Raises:
            ValueError: ``fresh`` has the wrong shape.
        """
        t_ns = check_time(t_ns)
        w, shape = self._tracks, (self.arm.n_patches,)
        flags = np.ones(shape, np.bool_) if fresh is None else np.asarray(fresh, np.bool_)
        if flags.shape != shape:
            raise ValueError(f"fresh must have shape {shape}, got {flags.shape}")
        n = min(len(contacts), MAX_TRACKS)
        chosen = np.arange(n)
        if len(contacts) > n:
            chosen = np.argsort(-np.nan_to_num(contacts.force), kind="stable")[:n]
        c = self._contacts[:n]
        for name in ("link", "patch", "quality"):
            c[name] = getattr(contacts, name)[chosen]
        for k, name in enumerate(_PLACE):
            c["z"][:, k] = getattr(contacts, name)[chosen]
        c["R"] = contacts.covariance[chosen]
        if self._waiting:
            self._take_up(t_ns, flags)
        dt = self._begin(t_ns)
        self._price(n, dt, t_ns)
        (live,) = np.nonzero((w["identity"] != 0) & (w["state"] != LIFT))
        i, j = linear_sum_assignment(self._cost[live, :n])
        i = live[i]
        is_pair = self._cost[i, j] < COST_NONE
        i, j = i[is_pair], j[is_pair]
        w["row"][i], c["track"][j] = j, i
        w["doubted"][i] |= self._cost[i, j] >= COST_AGAIN
        for k in live[w["row"][live] < 0].tolist():
            self._miss(k, c, t_ns, flags)
        _take(w, c, self._surface, dt, t_ns)
        self._spawn(t_ns, c)

        rows = np.flatnonzero(w["identity"])
        place = np.full(MAX_TRACKS + 1, -1, np.int64)  # the last one is that of no track
        place[rows] = np.arange(len(rows))
        contact_row = np.full(len(contacts), -1, np.int64)
        contact_row[chosen] = place[c["track"]]
        shown = w[rows]
        seen = shown["row"] >= 0
        shown["row"][seen] = chosen[shown["row"][seen]]
        return Tracks(t_ns=t_ns, contact_row=contact_row, **{name: shown[name] for name in _PUBLIC})

    def _price(self, n: int, dt: float, t_ns: int) -> None:
        _price(self._tracks, self._contacts[:n], self._surface, self._away, self._cost, dt, t_ns)

    def _begin(self, t_ns: int) -> float:
        """Free what was lifted in the last cycle, end what was not seen for too long; return the step, s."""
        w = self._tracks
        dt_ns = 0 if self._last_ns is None else t_ns - self._last_ns
        self._last_ns = t_ns
        lifted = w["state"] == LIFT
        w["identity"][lifted] = w["id"][lifted] = w["state"][lifted] = 0
        w["slot"][lifted] = -1
        if dt_ns < 0:  # the clock was set back: everything that was remembered goes with it
            for name in ("born_ns", "seen_ns", "updated_ns", "shown_ns"):
                w[name] += dt_ns
        w["row"], w["shared"] = -1, False
        w["missed"] += 1
        w["state"][(w["identity"] != 0) & (t_ns - w["seen_ns"] > self._blind_ns)] = LIFT
        return 1e-9 * max(dt_ns, 0)

    def _spawn(self, t_ns: int, c: Rows) -> None:
        """Begin a track for contacts that have none, the strongest first; give free slots to the oldest."""
        w, (s, a, force) = self._tracks, c["z"].T
        new = np.flatnonzero(c["usable"] & (c["track"] < 0))
        order = np.lexsort((a[new], s[new], c["link"][new], -force[new]))
        free = np.flatnonzero(w["identity"] == 0)
        for i, j in zip(free.tolist(), new[order].tolist(), strict=False):
            identity, number = self._last[0] + 1, self._last[1] % N_IDS + 1
            while number in w["id"]:
                number = number % N_IDS + 1
            self._last = identity, number
            link, patch = int(c["link"][j]), int(c["patch"][j])
            self._put(i, KeptTrack(identity, number, -1, link, patch, *c["z"][j].tolist()), t_ns)
            w["covariance"][i, [0, 1, 4], [0, 1, 4]] = c["R"][j].diagonal()
            w["state"][i], w["row"][i], c["track"][j] = TOUCH, j, i
        waits = np.flatnonzero((w["identity"] != 0) & (w["slot"] < 0) & (w["row"] >= 0))
        if len(waits):
            slots = np.setdiff1d(np.arange(self._n_slots), w["slot"])
            for i, slot in zip(waits[np.argsort(w["identity"][waits])], slots, strict=False):
                w["slot"][i], w["state"][i] = slot, TOUCH

    def _take_up(self, t_ns: int, fresh: Bools) -> None:
        """Begin the tracks whose patches are read, before the contacts of this cycle are looked at."""
        w, waiting = self._tracks, self._waiting
        self._first_ns = t_ns if self._first_ns is None else self._first_ns
        waiting = [entry for entry in waiting if t_ns - self._first_ns <= entry[1]]
        self._waiting = [entry for entry in waiting if not fresh[entry[0].patch]]
        for track, _ in waiting:
            free = np.flatnonzero(w["identity"] == 0)
            is_new = track.identity not in w["identity"] and track.id not in w["id"]
            if fresh[track.patch] and len(free) and is_new:
                slot = track.slot if track.slot < self._n_slots and track.slot not in w["slot"] else -1
                self._put(int(free[0]), track._replace(slot=slot), t_ns)

    def _put(self, i: int, track: KeptTrack, t_ns: int) -> None:
        """Begin a track in row i where it was last seen; its speed is not known."""
        t, place = self._tracks[i : i + 1], (track.s, track.a, track.force)
        t[:] = np.zeros(1, TRACK)
        for name, value in zip(KeptTrack._fields, track, strict=True):
            t[name] = value
        t["state"], t["row"], t["hider"] = HELD, -1, -1
        for name in ("born_ns", "seen_ns", "updated_ns", "shown_ns"):
            t[name] = t_ns
        t["mean"][0, [0, 1, 4]] = place
        variance = [RESUMED_M**2] * 2 + [SIGMA_SPEED**2] * 2 + [1.0 + (0.5 * track.force) ** 2]
        t["covariance"][0] = np.diag(variance)

    def _miss(self, i: int, c: Rows, t_ns: int, fresh: Bools) -> None:
        """Decide for a track without a contact why that is, and whether it has ended."""
        w, arm, t = self._tracks, self.arm, self._tracks[i]
        surface, x, before = arm.links[t["link"]].surface, t["mean"], t["hider"]
        t["hider"], t["state"], t["why"] = -1, COAST, MISSED
        (j,) = np.nonzero((c["track"] >= 0) & (self._away[i, : len(c)] <= MERGE_REACH))
        if t_ns - t["seen_ns"] <= self._merge_ns and len(j):
            # a contact near and strong enough to be that of both; two that meet have both been there before
            others = w[c["track"][j]]
            share = np.where(c["track"][j] == before, MERGE_LEAVE, MERGE_ENTER)
            strong = c["z"][j, 2] >= others["mean"][:, 4] + share * x[4]
            apart = np.hypot(*(x[2:4] - others["mean"][:, 2:4]).T)
            may = (t["moving"] | others["moving"]) & (apart > SPEED_MOVE) | (c["quality"][j] & BAD_FIT != 0)
            may = strong | (may & (t_ns - t["shown_ns"] <= WEAK_NS))
            may &= others["born_ns"] <= t["seen_ns"]
            if may.any():
                k = int(np.where(may, self._away[i, j], np.inf).argmin())
                hider, z = int(c["track"][j[k]]), c["z"][j[k], :2]
                t["hider"], t["why"], w["shared"][hider] = hider, HIDDEN, True
                if strong[k]:
                    t["shown_ns"] = t_ns
                    for one in (i, hider):  # they go on, but not out of the contact
                        off = w["mean"][one, :2] - z
                        off[1] = surface.wrap(off[1])
                        off *= min(1.0, MERGE_STAY / max(self._away[one, j[k]], MERGE_STAY))
                        w["mean"][one, :2] = z + off
                return
        on = arm.patch_link == t["link"]
        here = np.where(on, surface.distance(arm.patch_s, arm.patch_a, x[0], x[1]), np.inf).argmin()
        on = arm.tactel_healthy & (arm.tactel_link == t["link"])
        d = surface.distance(arm.tactel_s[on], arm.tactel_a[on], x[0], x[1]) / self._pitch[on]
        in_gap = t["moving"] and GAP[0] < d.min(initial=np.inf) <= GAP[1]
        if in_gap or not (fresh[t["patch"]] and fresh[here]):
            t["why"] = BLIND
        elif t["missed"] > self._coast_cycles:
            t["state"] = LIFT


@kernel
def _price(
    tracks: Rows, contacts: Rows, surface: Floats, away: Floats, cost: Floats, dt: float, t_ns: int
) -> None:
    """Carry the tracks on by dt (s); write how far off contacts are, m, and what it costs to pair them."""
    n = len(contacts)
    for j in range(n):
        _check_contact(contacts[j], surface)
    for i in range(len(tracks)):
        t = tracks[i]
        is_live = t["identity"] != 0 and t["state"] != LIFT
        on = surface_of(surface, t["link"])
        if is_live:
            _predict(t, on, dt)
        for j in range(n):
            c = contacts[j]
            away[i, j] = np.inf
            if is_live and c["usable"] and c["link"] == t["link"]:
                away[i, j] = distance(on, t["mean"][0], t["mean"][1], c["z"][0], c["z"][1])
    for j in range(n):
        near, c = 0, contacts[j]
        for i in range(len(tracks)):
            near += away[i, j] <= CROWD
        c["crowded"] = near > 1
        if near > 1:  # errors of contacts that are near others are common, and no covariance says so
            c["R"][0, 0] += SIGMA_CROWD**2
            c["R"][1, 1] += (SIGMA_CROWD / _scale_of_a(surface_of(surface, c["link"]), c["z"][0])) ** 2
            c["R"][2, 2] += (FORCE_CROWD * c["z"][2]) ** 2
        for i in range(len(tracks)):
            cost[i, j] = COST_NONE
            if away[i, j] < np.inf:
                cost[i, j] = _pair_cost(tracks[i], c, surface_of(surface, c["link"]), away[i, j], t_ns)


@kernel
def _take(tracks: Rows, contacts: Rows, surface: Floats, dt: float, t_ns: int) -> None:
    """Take in what tracks are seen as; correct the filters of those that do not share their contact."""
    for i in range(len(tracks)):
        t = tracks[i]
        if t["identity"] == 0 or t["row"] < 0:
            continue
        c, on, x = contacts[t["row"]], surface_of(surface, t["link"]), t["mean"]
        t["s"], t["a"], t["force"] = c["z"][0], c["z"][1], c["z"][2]
        t["patch"], t["missed"], t["why"], t["hider"] = c["patch"], 0, SEEN, -1
        t["seen_ns"] = t["shown_ns"] = t_ns
        if dt > 0.0 and not t["shared"]:
            _correct(t, c, on, t_ns)
        scale2 = _scale_of_a(on, x[0]) ** 2
        speed2 = x[2] ** 2 + scale2 * x[3] ** 2
        noise2 = max(t["covariance"][2, 2], scale2 * t["covariance"][3, 3])
        least2 = SPEED_HELD**2 if t["moving"] else max(SPEED_MOVE**2, 9.0 * noise2)
        t["moving"] = speed2 > least2
        t["state"] = MOVE if t["moving"] else HELD


@inner_kernel
def _predict(t: Any, on: LinkSurface, dt: float) -> None:
    """Carry a track on by dt, s."""
    x, P, scale = t["mean"], t["covariance"], _scale_of_a(on, t["mean"][0])
    for k in range(2):
        q = ACCELERATION if k == 0 else ACCELERATION / (scale * scale)
        x[k] += dt * x[k + 2]
        P[k, k] += dt * (2.0 * P[k, k + 2] + dt * P[k + 2, k + 2]) + q * dt * dt * dt / 3.0
        P[k, k + 2] += dt * P[k + 2, k + 2] + 0.5 * q * dt * dt
        P[k + 2, k] = P[k, k + 2]
        P[k + 2, k + 2] += q * dt
    P[4, 4] += FORCE_WALK * dt
    x[1] = wrap(x[1], on.period)


@inner_kernel
def _miss_of(t: Any, c: Any, on: LinkSurface, slack: float) -> tuple[float, float, float, float]:
    """Return how far a contact is off a track along s and a, m, the normalised square of that, and det C.

    slack: more of a place error, m
    """
    P, R, scale = t["covariance"], c["R"], _scale_of_a(on, t["mean"][0])
    ds, da = c["z"][0] - t["mean"][0], wrap(c["z"][1] - t["mean"][1], on.period)
    css, csa = P[0, 0] + R[0, 0] + slack * slack, R[0, 1]
    caa = P[1, 1] + R[1, 1] + (slack / scale) ** 2
    det = css * caa - csa * csa
    return ds, da, (caa * ds * ds - 2.0 * csa * ds * da + css * da * da) / det, det * scale * scale


@inner_kernel
def _correct(t: Any, c: Any, on: LinkSurface, t_ns: int) -> None:
    """Correct the filter of a track by a contact, unless it is the first that is off its line."""
    x, P, R = t["mean"], t["covariance"], c["R"]
    ds, da, d2, _ = _miss_of(t, c, on, 0.0)
    if d2 > GATE and not c["crowded"]:
        if not t["doubted"]:  # a contact at a seam may be wrong by more than it says: wait for the next
            t["doubted"] = True
            return
        for k in range(5):  # a manoeuvre: forget the past in the measure that it was wrong
            for m in range(5):
                P[k, m] *= d2 / GATE
    t["doubted"] = False
    t["updated_ns"] = t_ns
    for k in range(2):
        y, r, v = ds if k == 0 else da, R[k, k], k + 2
        total = P[k, k] + r
        x[k] += P[k, k] / total * y
        x[v] += P[k, v] / total * y
        least = 1e-9 * P[v, v]  # what rounding leaves of a difference stays positive
        P[v, v] = max(P[v, v] - P[k, v] * P[k, v] / total, least)
        P[k, k] *= r / total
        most = CORRELATION_MOST * math.sqrt(P[k, k] * P[v, v])
        P[k, v] = P[v, k] = min(max(P[k, v] * r / total, -most), most)
    total = P[4, 4] + R[2, 2]
    x[4] += P[4, 4] / total * (c["z"][2] - x[4])
    P[4, 4] *= R[2, 2] / total
    x[1] = wrap(x[1], on.period)


@inner_kernel
def _check_contact(c: Any, surface: Floats) -> None:
    """Note whether a contact can be used, and bring its covariance between floor and ceiling."""
    R, s, force, known = c["R"], c["z"][0], c["z"][2], math.isfinite(c["R"][0, 1])
    c["track"] = -1
    ok = abs(s) < FAR and abs(c["z"][1]) < FAR and 0.0 <= force < 1e6 * FAR  # false for NaN
    c["usable"] = ok and 0 <= c["link"] < len(surface)
    if not c["usable"]:
        return
    for k in range(3):
        known = known and 0.0 < R[k, k] < np.inf
    rho = R[0, 1] / math.sqrt(R[0, 0] * R[1, 1]) if known else 0.0
    unit = 1.0 / _scale_of_a(surface_of(surface, c["link"]), s)
    unknown = SIGMA_UNKNOWN, unit * SIGMA_UNKNOWN, FORCE_UNKNOWN * force + 0.05
    least = SIGMA_FLOOR, unit * SIGMA_FLOOR, FORCE_FLOOR * (force + 1.0)
    most = SIGMA_CEILING, unit * SIGMA_CEILING, force + 1.0
    for k in range(3):
        R[k, k] = (min(max(math.sqrt(R[k, k]), least[k]), most[k]) if known else unknown[k]) ** 2
    rho = min(max(rho, -CORRELATION_MOST), CORRELATION_MOST)
    R[0, 1] = R[1, 0] = rho * math.sqrt(R[0, 0] * R[1, 1])


@inner_kernel
def _scale_of_a(on: LinkSurface, s: float) -> float:
    """Return metres on the surface per metre of a."""
    return float(max(1.0 + on.taper * (s - 0.5 * on.length) / on.radius, SCALE_LEAST))


@inner_kernel
def _pair_cost(t: Any, c: Any, on: LinkSurface, away: float, t_ns: int) -> float:
    """Return what it costs to take a contact that is so far away (m) for a track, COST_NONE at most."""
    slack = min(MANOEUVRE * 1e-9 * (t_ns - t["updated_ns"]), MANOEUVRE_MOST)
    _, _, d2, det = _miss_of(t, c, on, slack)
    if d2 <= GATE and away <= REACH:
        df2 = (c["z"][2] - t["mean"][4]) ** 2 / (t["covariance"][4, 4] + c["R"][2, 2])
        cost = d2 + min(df2, FORCE_MOST) + math.log(det * 1e12)  # mm^2
        return float(cost + COST_HIDDEN) if t["hider"] >= 0 else float(cost)
    if t["hider"] < 0:
        away = min(away, distance(on, t["s"], t["a"], c["z"][0], c["z"][1]))
    return COST_AGAIN + 100.0 * away if away < AGAIN_REACH else COST_NONE
