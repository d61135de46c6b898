"""Tracks: contacts with an identity over time, a filtered place and force, a velocity, and what they do.

::

             seen                 seen                   unseen too long, or no reason to wait
    ──► TOUCH ──► HELD ◄──► MOVE ──► (any) ──► COAST ─────────────────────────────► LIFT ──► gone
                                       ▲ seen    │
                                       └─────────┘

A track that is not seen in a cycle coasts and says so; what it shows is where it was last seen. How long it
may coast depends on why it is not seen:

    MISSED   its patch sends readings and they show nothing: a cycle or two
    BLIND    the readings of its patch are missing: until they are back, at most ``blind_s``; or it moves
             through a gap between boards: until it is past that
    HIDDEN   a contact close by is strong enough to be both: two touches that cross; at most ``merge_s``.
             Or too weak, but one that its law does not explain, or of a touch that it moves against: fit
             may show one of two; 0.15 s

While a contact is that of two tracks, neither filter takes it in: both go on as they moved, so that they are
distinguished by their motion when they part.

An estimate at a seam may jump by half a pitch for a cycle. The first contact off the line of a track is its
own, and is shown, but its filter waits for a second. A contact that no track expects, two pitches or less
from one that has none, is that one's.

Time: steps may be of any length. After a gap longer than ``blind_s`` every track ends. A cycle whose time is
that of the last one, or before it, moves identities and raw places on but leaves the filters as they are; a
clock set back takes all remembered times with it.

Assumptions: contacts move less than about 1 m/s, and two that meet keep their speed while they cannot be
distinguished. Where that fails, identities are exchanged or begin anew; places and forces are never touched.
Two touches that turn back within a cycle or two are taken for two that crossed.

Limit, measured by ``python -m tests.estimate.crossing 100``: of 100 pairs of touches of 8 N on a forearm that
pass each other at 0.1 to 1 m/s each, head-on or at an angle of 90 degrees and more, 97 and more keep their
identities with level ``fit``, 99 and more with ``full``, with the cone and with the law that ships. They need
three cycles before they meet: a speed is not known sooner. With ``kmeans``, 84 to 100. Two that turn back
8 mm apart at 0.1 m/s each keep theirs with ``full``, nine in ten with ``fit``; at 0.2 and more they are taken
for two that crossed, since nothing but a sudden stop distinguishes them.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.contacts import Contacts
from skinbus.estimate.kernels.array_table import array_table
from skinbus.estimate.tracking import state as k
from skinbus.estimate.tracking.state import Floats, Ints
from skinbus.estimate.tracking.step import step
from skinbus.estimate.validation import check_arm, check_time
from skinbus.model import Arm

RESUMED_M: Final = 5e-3
"""Where a contact may be after a restart, one standard deviation, m: half a pitch."""


class TrackState(enum.IntEnum):
    """What a track does; the first five are those of the contact TPDO."""

    NONE = k.FREE
    TOUCH = k.TOUCH
    """Seen for the first time, or for the first time with a slot."""
    HELD = k.HELD
    LIFT = k.LIFT
    """Has ended: said once, then the track is gone."""
    COAST = k.COAST
    """Not seen in this cycle."""
    MOVE = k.MOVE


class Unseen(enum.IntEnum):
    """Why a track coasts or has ended."""

    SEEN = k.SEEN
    MISSED = k.MISSED
    BLIND = k.BLIND
    HIDDEN = k.HIDDEN


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
        if not 1 <= n_slots <= k.MAX_TRACKS:
            raise ValueError(f"n_slots must be 1..{k.MAX_TRACKS}, got {n_slots}")
        if coast_cycles < 0 or not 0.0 < merge_s <= blind_s < 3600.0:
            raise ValueError(
                f"wanted coast_cycles >= 0 and 0 < merge_s <= blind_s < 3600; "
                f"got {coast_cycles}, {merge_s}, {blind_s}"
            )
        self.arm = arm
        self._ground = k.make_ground(arm)
        self._ground_table = array_table(self._ground)
        self._n_slots = n_slots
        self._coast_cycles = coast_cycles
        self._blind_ns = round(1e9 * blind_s)
        self._merge_ns = round(1e9 * merge_s)
        self._take_work(k.make_track_work(arm.n_patches, n_slots))
        self._run(0, 0)
        self._waiting: list[tuple[KeptTrack, int]] = []
        self._first_ns: int | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all tracks at once, without a word; identities go on counting."""
        old = self._work
        self._take_work(k.make_track_work(self.arm.n_patches, self._n_slots))
        self._work.clock[: k.LAST_T] = old.clock[: k.LAST_T]

    def kept(self) -> list[KeptTrack]:
        """Return the contacts that are shown, those among them that still wait for their patch."""
        w = self._work
        rows = np.flatnonzero((w.identity != 0) & (w.slot >= 0) & (w.state != k.LIFT))
        columns = (w.identity, w.id, w.slot, w.link, w.patch, *w.raw.T)
        found = zip(*(column[rows].tolist() for column in columns), strict=True)
        return [*(KeptTrack(*row) for row in found), *(track for track, _ in self._waiting)]

    def last(self) -> tuple[int, int]:
        """Return the identity and the number that were given last."""
        return int(self._work.clock[k.LAST_IDENTITY]), int(self._work.clock[k.LAST_ID])

    def resume(self, track: KeptTrack, within_s: float) -> None:
        """Take up a contact as soon as its patch is read, if that is within this time of the first cycle."""
        self._waiting.append((track, round(1e9 * within_s)))

    def resume_counts(self, identity: int, number: int) -> None:
        """Go on counting identities and numbers after those that were given last."""
        clock = self._work.clock
        clock[k.LAST_IDENTITY] = max(int(clock[k.LAST_IDENTITY]), identity)
        clock[k.LAST_ID] = number % (k.N_IDS + 1)

    def _take_up(self, t_ns: int) -> None:
        """Begin the tracks whose patches are read, before the contacts of this cycle are looked at."""
        w = self._work
        if self._first_ns is None:
            self._first_ns = t_ns
        still: list[tuple[KeptTrack, int]] = []
        for track, within_ns in self._waiting:
            if t_ns - self._first_ns > within_ns:
                continue
            if not w.fresh[track.patch]:
                still.append((track, within_ns))
                continue
            free = np.flatnonzero(w.identity == 0)
            if len(free) and track.identity not in w.identity and track.id not in w.id:
                self._put(int(free[0]), track, t_ns)
        self._waiting = still

    def _put(self, i: int, track: KeptTrack, t_ns: int) -> None:
        """Begin a track in row i where it was last; its speed is not known."""
        w = self._work
        w.identity[i], w.id[i], w.link[i], w.patch[i] = track.identity, track.id, track.link, track.patch
        w.state[i], w.why[i], w.row[i], w.hider[i] = k.HELD, k.SEEN, -1, -1
        w.slot[i] = track.slot if track.slot < len(w.slot_used) and not w.slot_used[track.slot] else -1
        if w.slot[i] >= 0:
            w.slot_used[w.slot[i]] = True
        w.born_ns[i] = w.seen_ns[i] = w.updated_ns[i] = w.shown_ns[i] = t_ns
        w.doubted[i] = False
        w.missed[i], w.shared[i], w.moving[i] = 0, False, False
        w.raw[i] = track.s, track.a, track.force
        w.x[i] = track.s, track.a, 0.0, 0.0, track.force
        w.U[i] = np.eye(len(w.x[i]))
        place, speed, force = RESUMED_M**2, k.SIGMA_SPEED**2, 1.0 + (0.5 * track.force) ** 2
        w.D[i] = place, place, speed, speed, force
        w.P[i] = np.diag(w.D[i])

    def _take_work(self, work: k.TrackWork) -> None:
        self._work, self._work_table = work, array_table(work)

    def update(self, contacts: Contacts, t_ns: int, fresh: npt.ArrayLike | None = None) -> Tracks:
        """Return the tracks after one cycle, those lifted in it included.

        contacts: of this cycle; the strongest 64 are looked at. Rows that are not finite are left out.
        t_ns:     time of the cycle.
        fresh:    (n_patches,) False where readings are missing; None for all there.
        """
        t_ns = check_time(t_ns)
        w = self._work
        if fresh is None:
            w.fresh[:] = True
        else:
            flags = np.asarray(fresh, np.bool_)
            if flags.shape != w.fresh.shape:
                raise ValueError(f"fresh must have shape {w.fresh.shape}, got {flags.shape}")
            w.fresh[:] = flags
        chosen: slice | Ints = slice(0, len(contacts))
        n = len(contacts)
        if n > k.MAX_TRACKS:
            chosen = np.argsort(-np.nan_to_num(contacts.force), kind="stable")[: k.MAX_TRACKS]
            n = k.MAX_TRACKS
        w.c_link[:n] = contacts.link[chosen]
        w.c_patch[:n] = contacts.patch[chosen]
        w.c_z[:n, 0] = contacts.s[chosen]
        w.c_z[:n, 1] = contacts.a[chosen]
        w.c_z[:n, 2] = contacts.force[chosen]
        w.c_cov[:n] = contacts.covariance[chosen]
        w.c_quality[:n] = contacts.quality[chosen]
        if self._waiting:
            self._take_up(t_ns)
        self._run(t_ns, n)
        return self._tracks(t_ns, len(contacts), chosen, n)

    def _run(self, t_ns: int, n: int) -> None:
        step(
            self._work_table, self._ground_table, t_ns, n, self._coast_cycles, self._blind_ns, self._merge_ns
        )

    def _tracks(self, t_ns: int, n_contacts: int, chosen: slice | Ints, n: int) -> Tracks:
        w = self._work
        rows = np.flatnonzero(w.identity)
        place = np.full(k.MAX_TRACKS + 1, -1, np.int64)  # the last one is that of no track
        place[rows] = np.arange(len(rows))
        contact_row = np.full(n_contacts, -1, np.int64)
        contact_row[chosen] = place[w.c_track[:n]]
        raw = w.raw[rows]
        row = w.row[rows]
        if not isinstance(chosen, slice):
            row = np.where(row >= 0, chosen[row], -1)
        return Tracks(
            t_ns=t_ns,
            identity=w.identity[rows],
            id=w.id[rows],
            slot=w.slot[rows],
            state=w.state[rows],
            why=w.why[rows],
            row=row,
            link=w.link[rows],
            patch=w.patch[rows],
            s=raw[:, 0],
            a=raw[:, 1],
            force=raw[:, 2],
            mean=w.x[rows],
            covariance=w.P[rows],
            born_ns=w.born_ns[rows],
            seen_ns=w.seen_ns[rows],
            contact_row=contact_row,
        )
