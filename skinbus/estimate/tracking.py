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
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from skinbus.estimate.columns import filled
from skinbus.estimate.contacts import Contacts
from skinbus.estimate.kernels.array_table import array_table
from skinbus.estimate.kernels.constants import BAD_FIT
from skinbus.estimate.kernels.geometry import distance, surface_of, wrap
from skinbus.estimate.validation import check_arm, check_time
from skinbus.jit import inner_kernel, kernel
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

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


class _Work(NamedTuple):
    """Columns of MAX_TRACKS rows: tracks, contacts of this cycle (c_...), and what both have together."""

    identity: Ints  # 0 where the row is free
    id: Ints
    slot: Ints
    state: Ints
    why: Ints
    row: Ints  # contact of this cycle, -1 for none
    link: Ints
    patch: Ints
    raw: Floats  # (m, 3) s, a, force as last seen
    born_ns: Ints
    seen_ns: Ints
    updated_ns: Ints  # last time the filter took a contact in
    shown_ns: Ints  # last time it was seen, or a contact was strong enough to be its too
    doubted: Bools  # the last contact was off its line, and not taken in
    missed: Ints  # cycles since it was seen
    hider: Ints  # track whose contact hides it, -1 for none
    shared: Bools  # its contact is that of hidden tracks too
    moving: Bools
    x: Floats  # (m, 5)
    P: Floats  # (m, 5, 5)

    c_link: Ints
    c_patch: Ints
    c_quality: Ints
    c_z: Floats  # (m, 3)
    c_cov: Floats  # (m, 3, 3)
    c_track: Ints  # the track it went to, -1 for none
    c_usable: Bools
    c_crowded: Bools

    away: Floats  # (m, m) m, tracks from contacts; infinite where they are not of one link
    cost: Floats  # (m, m)
    surface: Floats  # (n_links, 4), see ``kernels.geometry.LinkSurface``


def _make_work(arm: Arm) -> _Work:
    m = MAX_TRACKS
    shapes = {"raw": (m, 3), "x": (m, 5), "P": (m, 5, 5), "c_z": (m, 3), "c_cov": (m, 3, 3)}
    made: dict[str, Any] = {name: np.zeros(shape) for name, shape in shapes.items()}
    made |= {name: np.full(m, -1, np.int64) for name in ("slot", "row", "hider")}
    made |= {name: np.full((m, m), np.inf) for name in ("away", "cost")}
    surface = np.stack([arm.link_radius, arm.link_taper, arm.link_period, arm.link_length], -1)
    return filled(_Work, m, {}, surface=surface, **made)


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
        self._waiting: list[tuple[KeptTrack, int]] = []
        self._first_ns: int | None = None
        self._last = (0, 0)
        self.reset()
        _price(self._table, 0.0, 0, 0)  # compiled now
        _take(self._table, 0.0, 0)

    def reset(self) -> None:
        """Forget all tracks at once, without a word; identities go on counting."""
        self._work = _make_work(self.arm)
        self._table = array_table(self._work)
        self._last_ns: int | None = None

    def kept(self) -> list[KeptTrack]:
        """Return the contacts that are shown, those among them that still wait for their patch."""
        w = self._work
        rows = np.flatnonzero((w.identity != 0) & (w.slot >= 0) & (w.state != LIFT))
        columns = (w.identity, w.id, w.slot, w.link, w.patch, *w.raw.T)
        found = zip(*(column[rows].tolist() for column in columns), strict=True)
        return [*(KeptTrack(*row) for row in found), *(track for track, _ in self._waiting)]

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
        w, shape = self._work, (self.arm.n_patches,)
        flags = np.ones(shape, np.bool_) if fresh is None else np.asarray(fresh, np.bool_)
        if flags.shape != shape:
            raise ValueError(f"fresh must have shape {shape}, got {flags.shape}")
        n = min(len(contacts), MAX_TRACKS)
        chosen = np.arange(n)
        if len(contacts) > n:
            chosen = np.argsort(-np.nan_to_num(contacts.force), kind="stable")[:n]
        w.c_link[:n], w.c_patch[:n] = contacts.link[chosen], contacts.patch[chosen]
        w.c_z[:n] = np.stack([contacts.s, contacts.a, contacts.force], -1)[chosen]
        w.c_cov[:n], w.c_quality[:n] = contacts.covariance[chosen], contacts.quality[chosen]
        if self._waiting:
            self._take_up(t_ns, flags)
        dt = self._begin(t_ns)
        _price(self._table, dt, t_ns, n)
        (live,) = np.nonzero((w.identity != 0) & (w.state != LIFT))
        cost = w.cost[live, :n]
        i, j = linear_sum_assignment(cost)
        paid = cost[i, j]
        i, j = live[i[paid < COST_NONE]], j[paid < COST_NONE]
        w.row[i], w.c_track[j] = j, i
        w.doubted[i] |= w.cost[i, j] >= COST_AGAIN
        for k in live[w.row[live] < 0].tolist():
            self._miss(k, n, t_ns, flags)
        _take(self._table, dt, t_ns)
        self._spawn(t_ns, n)
        return self._tracks(t_ns, len(contacts), chosen)

    def _begin(self, t_ns: int) -> float:
        """Free what was lifted in the last cycle, end what was not seen for too long; return the step, s."""
        w = self._work
        dt_ns = 0 if self._last_ns is None else t_ns - self._last_ns
        self._last_ns = t_ns
        lifted = w.state == LIFT
        w.identity[lifted] = w.id[lifted] = 0
        w.state[lifted], w.slot[lifted] = FREE, -1
        if dt_ns < 0:  # the clock was set back: everything that was remembered goes with it
            for column in (w.born_ns, w.seen_ns, w.updated_ns, w.shown_ns):
                column += dt_ns
        w.row[:], w.shared[:] = -1, False
        w.missed[:] += 1
        w.state[(w.identity != 0) & (t_ns - w.seen_ns > self._blind_ns)] = LIFT
        return 1e-9 * max(dt_ns, 0)

    def _spawn(self, t_ns: int, n: int) -> None:
        """Begin a track for contacts that have none, the strongest first; give free slots to the oldest."""
        w = self._work
        new = np.flatnonzero(w.c_usable[:n] & (w.c_track[:n] < 0))
        order = np.lexsort((w.c_z[new, 1], w.c_z[new, 0], w.c_link[new], -w.c_z[new, 2]))
        free = np.flatnonzero(w.identity == 0)
        for i, j in zip(free.tolist(), new[order].tolist(), strict=False):
            identity, number = self._last[0] + 1, self._last[1] % N_IDS + 1
            while number in w.id:
                number = number % N_IDS + 1
            self._last = identity, number
            link, patch = int(w.c_link[j]), int(w.c_patch[j])
            self._put(i, KeptTrack(identity, number, -1, link, patch, *w.c_z[j].tolist()), t_ns)
            w.P[i, [0, 1, 4], [0, 1, 4]] = w.c_cov[j].diagonal()
            w.state[i], w.row[i], w.c_track[j] = TOUCH, j, i
        waits = np.flatnonzero((w.identity != 0) & (w.slot < 0) & (w.row >= 0))
        if len(waits):
            slots = np.setdiff1d(np.arange(self._n_slots), w.slot)
            for i, slot in zip(waits[np.argsort(w.identity[waits])], slots, strict=False):
                w.slot[i], w.state[i] = slot, TOUCH

    def _take_up(self, t_ns: int, fresh: Bools) -> None:
        """Begin the tracks whose patches are read, before the contacts of this cycle are looked at."""
        w = self._work
        if self._first_ns is None:
            self._first_ns = t_ns
        still: list[tuple[KeptTrack, int]] = []
        for track, within_ns in self._waiting:
            if t_ns - self._first_ns > within_ns:
                continue
            if not fresh[track.patch]:
                still.append((track, within_ns))
                continue
            free = np.flatnonzero(w.identity == 0)
            if len(free) and track.identity not in w.identity and track.id not in w.id:
                slot = track.slot if track.slot < self._n_slots and track.slot not in w.slot else -1
                self._put(int(free[0]), track._replace(slot=slot), t_ns)
        self._waiting = still

    def _put(self, i: int, track: KeptTrack, t_ns: int) -> None:
        """Begin a track in row i where it was last seen; its speed is not known."""
        w = self._work
        w.identity[i], w.id[i], w.slot[i], w.link[i], w.patch[i] = track[:5]
        w.state[i], w.why[i], w.row[i], w.hider[i], w.missed[i] = HELD, SEEN, -1, -1, 0
        w.doubted[i] = w.shared[i] = w.moving[i] = False
        w.born_ns[i] = w.seen_ns[i] = w.updated_ns[i] = w.shown_ns[i] = t_ns
        w.raw[i] = track.s, track.a, track.force
        w.x[i] = track.s, track.a, 0.0, 0.0, track.force
        place, speed, force = RESUMED_M**2, SIGMA_SPEED**2, 1.0 + (0.5 * track.force) ** 2
        w.P[i] = np.diag([place, place, speed, speed, force])

    def _tracks(self, t_ns: int, n_contacts: int, chosen: npt.NDArray[np.intp]) -> Tracks:
        w = self._work
        rows = np.flatnonzero(w.identity)
        place = np.full(MAX_TRACKS + 1, -1, np.int64)  # the last one is that of no track
        place[rows] = np.arange(len(rows))
        contact_row = np.full(n_contacts, -1, np.int64)
        contact_row[chosen] = place[w.c_track[: len(chosen)]]
        row = w.row[rows]
        row[row >= 0] = chosen[row[row >= 0]]
        s, a, force = w.raw[rows].T
        names = ("identity", "id", "slot", "state", "why", "link", "patch", "born_ns", "seen_ns")
        columns = {name: getattr(w, name)[rows] for name in names}
        return Tracks(
            t_ns=t_ns,
            row=row,
            s=s,
            a=a,
            force=force,
            mean=w.x[rows],
            covariance=w.P[rows],
            contact_row=contact_row,
            **columns,
        )

    def _miss(self, i: int, n: int, t_ns: int, fresh: Bools) -> None:
        """Decide for a track without a contact why that is, and whether it has ended."""
        w, arm = self._work, self.arm
        before, hider = w.hider[i], -1
        w.hider[i], w.state[i], w.why[i] = -1, COAST, MISSED
        (j,) = np.nonzero((w.c_track[:n] >= 0) & (w.away[i, :n] <= MERGE_REACH))
        if t_ns - w.seen_ns[i] <= self._merge_ns and len(j):
            # a contact near and strong enough to be that of both; two that meet have both been there before
            other = w.c_track[j]
            share = np.where(other == before, MERGE_LEAVE, MERGE_ENTER)
            strong = w.c_z[j, 2] >= w.x[other, 4] + share * w.x[i, 4]
            apart = np.hypot(*(w.x[i, 2:4] - w.x[other, 2:4]).T)
            may = (w.c_quality[j] & BAD_FIT != 0) | ((w.moving[i] | w.moving[other]) & (apart > SPEED_MOVE))
            may = (strong | (may & (t_ns - w.shown_ns[i] <= WEAK_NS))) & (w.born_ns[other] <= w.seen_ns[i])
            if may.any():
                k = int(np.where(may, w.away[i, j], np.inf).argmin())
                hider = w.hider[i] = other[k]
                w.why[i], w.shared[hider] = HIDDEN, True
                if strong[k]:
                    w.shown_ns[i] = t_ns
                    for one in (i, hider):  # they go on, but not out of the contact
                        off = w.x[one, :2] - w.c_z[j[k], :2]
                        off[1] = arm.links[w.link[i]].surface.wrap(off[1])
                        off *= min(1.0, MERGE_STAY / max(w.away[one, j[k]], MERGE_STAY))
                        w.x[one, :2] = w.c_z[j[k], :2] + off
        if hider >= 0:
            return
        surface, (s, a) = arm.links[w.link[i]].surface, w.x[i, :2]
        on = arm.patch_link == w.link[i]
        here = np.where(on, surface.distance(arm.patch_s, arm.patch_a, s, a), np.inf).argmin()
        on = arm.tactel_healthy & (arm.tactel_link == w.link[i])
        d = surface.distance(arm.tactel_s[on], arm.tactel_a[on], s, a) / self._pitch[on]
        in_gap = w.moving[i] and GAP[0] < d.min(initial=np.inf) <= GAP[1]
        if in_gap or not (fresh[w.patch[i]] and fresh[here]):
            w.why[i] = BLIND
        elif w.missed[i] > self._coast_cycles:
            w.state[i] = LIFT


@kernel
def _price(w: _Work, dt: float, t_ns: int, n: int) -> None:
    """Carry the tracks on by dt (s); write what it costs to pair them with the n contacts in ``w.c_*``."""
    for j in range(n):
        _check_contact(w, j)
    for i in range(MAX_TRACKS):
        is_live = w.identity[i] != 0 and w.state[i] != LIFT
        if is_live:
            _predict(w, i, dt)
        for j in range(n):
            is_one = is_live and w.c_usable[j] and w.c_link[j] == w.link[i]
            w.away[i, j] = _distance(w, i, w.x[i], w.c_z[j]) if is_one else np.inf
    for j in range(n):
        near = 0
        for i in range(MAX_TRACKS):
            near += w.away[i, j] <= CROWD
        w.c_crowded[j] = near > 1
        if near > 1:  # errors of contacts that are near others are common, and no covariance says so
            w.c_cov[j, 0, 0] += SIGMA_CROWD**2
            w.c_cov[j, 1, 1] += (SIGMA_CROWD / _scale_of_a(w, w.c_link[j], w.c_z[j, 0])) ** 2
            w.c_cov[j, 2, 2] += (FORCE_CROWD * w.c_z[j, 2]) ** 2
        for i in range(MAX_TRACKS):
            w.cost[i, j] = _pair_cost(w, i, j, t_ns) if w.away[i, j] < np.inf else COST_NONE


@kernel
def _take(w: _Work, dt: float, t_ns: int) -> None:
    """Take in what tracks are seen as."""
    for i in range(MAX_TRACKS):
        if w.identity[i] != 0 and w.row[i] >= 0:
            w.hider[i] = -1
            _update(w, i, t_ns, dt)


@inner_kernel
def _predict(w: _Work, i: int, dt: float) -> None:
    """Carry a track on by dt, s."""
    x, P = w.x[i], w.P[i]
    scale = _scale_of_a(w, w.link[i], x[0])
    for k in range(2):
        q = ACCELERATION if k == 0 else ACCELERATION / (scale * scale)
        x[k] += dt * x[k + 2]
        P[k, k] += dt * (2.0 * P[k, k + 2] + dt * P[k + 2, k + 2]) + q * dt * dt * dt / 3.0
        P[k, k + 2] += dt * P[k + 2, k + 2] + 0.5 * q * dt * dt
        P[k + 2, k] = P[k, k + 2]
        P[k + 2, k + 2] += q * dt
    P[4, 4] += FORCE_WALK * dt
    x[1] = wrap(x[1], surface_of(w.surface, w.link[i]).period)


@inner_kernel
def _correct(w: _Work, i: int, j: int, t_ns: int) -> None:
    """Correct the filter of track i by contact j, unless it is the first that is off its line."""
    x, P, z, R = w.x[i], w.P[i], w.c_z[j], w.c_cov[j]
    period = surface_of(w.surface, w.link[i]).period
    ys, ya = z[0] - x[0], wrap(z[1] - x[1], period)
    css, csa, caa = P[0, 0] + R[0, 0], R[0, 1], P[1, 1] + R[1, 1]
    d2 = (caa * ys * ys - 2.0 * csa * ys * ya + css * ya * ya) / (css * caa - csa * csa)
    if d2 > GATE and not w.c_crowded[j]:
        if not w.doubted[i]:  # a contact at a seam may be wrong by more than it says: wait for the next
            w.doubted[i] = True
            return
        for k in range(5):  # a manoeuvre: forget the past in the measure that it was wrong
            for m in range(5):
                P[k, m] *= d2 / GATE
    w.doubted[i] = False
    w.updated_ns[i] = t_ns
    for k in range(2):
        y, r, v = ys if k == 0 else ya, R[k, k], k + 2
        total = P[k, k] + r
        x[k] += P[k, k] / total * y
        x[v] += P[k, v] / total * y
        least = 1e-9 * P[v, v]  # what rounding leaves of a difference stays positive
        P[v, v] = max(P[v, v] - P[k, v] * P[k, v] / total, least)
        P[k, k] *= r / total
        most = CORRELATION_MOST * math.sqrt(P[k, k] * P[v, v])
        P[k, v] = P[v, k] = min(max(P[k, v] * r / total, -most), most)
    total = P[4, 4] + R[2, 2]
    x[4] += P[4, 4] / total * (z[2] - x[4])
    P[4, 4] *= R[2, 2] / total
    x[1] = wrap(x[1], period)


@inner_kernel
def _check_contact(w: _Work, j: int) -> None:
    """Note whether a contact can be used, and bring its covariance between floor and ceiling."""
    R, s, a, force = w.c_cov[j], w.c_z[j, 0], w.c_z[j, 1], w.c_z[j, 2]
    w.c_track[j] = -1
    ok = abs(s) < FAR and abs(a) < FAR and 0.0 <= force < 1e6 * FAR  # false for NaN
    w.c_usable[j] = ok and 0 <= w.c_link[j] < len(w.surface)
    if not w.c_usable[j]:
        return
    known = math.isfinite(R[0, 1])
    for k in range(3):
        known = known and 0.0 < R[k, k] < np.inf
    rho = R[0, 1] / math.sqrt(R[0, 0] * R[1, 1]) if known else 0.0
    for k in range(3):
        unit = 1.0 / _scale_of_a(w, w.c_link[j], s) if k == 1 else 1.0
        unknown, least, most = unit * SIGMA_UNKNOWN, unit * SIGMA_FLOOR, unit * SIGMA_CEILING
        if k == 2:
            unknown, least, most = FORCE_UNKNOWN * force + 0.05, FORCE_FLOOR * (force + 1.0), force + 1.0
        R[k, k] = (min(max(math.sqrt(R[k, k]), least), most) if known else unknown) ** 2
    rho = min(max(rho, -CORRELATION_MOST), CORRELATION_MOST)
    R[0, 1] = R[1, 0] = rho * math.sqrt(R[0, 0] * R[1, 1])


@inner_kernel
def _scale_of_a(w: _Work, link: int, s: float) -> float:
    """Return metres on the surface per metre of a."""
    surface = surface_of(w.surface, link)
    return float(max(1.0 + surface.taper * (s - 0.5 * surface.length) / surface.radius, SCALE_LEAST))


@inner_kernel
def _distance(w: _Work, i: int, x: Floats, z: Floats) -> float:
    """Return the geodesic distance of two places (s, a, ...) on the link of track i, m."""
    return float(distance(surface_of(w.surface, w.link[i]), x[0], x[1], z[0], z[1]))


@inner_kernel
def _pair_cost(w: _Work, i: int, j: int, t_ns: int) -> float:
    """Return what it costs to take contact j for track i, COST_NONE at most."""
    x, P, z, R = w.x[i], w.P[i], w.c_z[j], w.c_cov[j]
    scale = _scale_of_a(w, w.link[i], x[0])
    slack = min(MANOEUVRE * 1e-9 * (t_ns - w.updated_ns[i]), MANOEUVRE_MOST)
    ds, da, df = z[0] - x[0], wrap(z[1] - x[1], surface_of(w.surface, w.link[i]).period), z[2] - x[4]
    css, csa = P[0, 0] + R[0, 0] + slack * slack, R[0, 1]
    caa = P[1, 1] + R[1, 1] + (slack / scale) ** 2
    det = css * caa - csa * csa
    d2 = (caa * ds * ds - 2.0 * csa * ds * da + css * da * da) / det
    is_hidden = w.hider[i] >= 0
    if d2 <= GATE and w.away[i, j] <= REACH:
        cost = (
            d2 + min(df * df / (P[4, 4] + R[2, 2]), FORCE_MOST) + math.log(det * scale * scale * 1e12)
        )  # mm^2
        return float(cost + COST_HIDDEN) if is_hidden else float(cost)
    near = w.away[i, j]
    if not is_hidden:
        near = min(near, _distance(w, i, w.raw[i], z))
    return COST_AGAIN + 100.0 * near if near < AGAIN_REACH else COST_NONE


@inner_kernel
def _update(w: _Work, i: int, t_ns: int, dt: float) -> None:
    """Take in what a track is seen as; correct its filter if it does not share its contact."""
    j, x, P = w.row[i], w.x[i], w.P[i]
    for k in range(3):
        w.raw[i, k] = w.c_z[j, k]
    w.patch[i] = w.c_patch[j]
    w.seen_ns[i] = w.shown_ns[i] = t_ns
    w.missed[i], w.why[i] = 0, SEEN
    if dt > 0.0 and not w.shared[i]:
        _correct(w, i, j, t_ns)
    scale = _scale_of_a(w, w.link[i], x[0])
    speed2 = x[2] ** 2 + (scale * x[3]) ** 2
    noise2 = max(P[2, 2], scale * scale * P[3, 3])
    if w.moving[i]:
        w.moving[i] = speed2 > SPEED_HELD**2
    else:
        w.moving[i] = speed2 > SPEED_MOVE**2 and speed2 > 9.0 * noise2
    w.state[i] = MOVE if w.moving[i] else HELD
