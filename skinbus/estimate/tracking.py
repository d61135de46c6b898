"""Tracks: contacts with an identity over time, a filtered place and force, a velocity, and what they do.

::

             seen                 seen                   unseen too long, or no reason to wait
    ──► TOUCH ──► HELD ◄──► MOVE ──► (any) ──► COAST ─────────────────────────────► LIFT ──► gone
                                       ▲ seen    │
                                       └─────────┘

A track that is not seen in a cycle coasts; it shows where it was last seen. How long it may coast depends on
why it is not seen:

    MISSED   its patch sends readings and they show nothing: a cycle or two
    BLIND    the readings of its patch are missing: until they are back; or it moves through a gap between
             boards: until it is past that
    HIDDEN   a contact close by is strong enough to be both: two touches that cross

Nothing coasts longer than ``blind_s``.

Filter: three independent Kalman filters, of s, a and force. Of a place the acceleration is white::

    x <- [[1, dt], [0, 1]] x,   P <- Phi P Phi' + q [[dt^3/3, dt^2/2], [dt^2/2, dt]]

Association: a track and a contact of one link may be paired if that is where the track is expected, or where
it was last, within what a hand moves in the time since (FASTEST, REACH). The pairs have the least sum of
squares of distance over that reach. While a contact is that of two tracks, neither filter takes it in: both
go on as they moved, and their motion distinguishes them when they part. An estimate at a seam may jump by
half a pitch for a cycle: the first contact off the line of a track is shown, but its filter waits for a
second.

Time: steps may be of any length. A contact that was sampled before the time of the cycle is compared with
where its track was then, [1, -age] x. After a gap longer than ``blind_s`` every track ends. A cycle whose
time is that of the last one, or before it, moves identities and raw places on but leaves the filters as they
are.

Limits: on a cone errors and speeds along a are taken as at the middle of the link. Contacts move less than
about 1 m/s, and two that meet keep their speed while they cannot be distinguished, else identities are
exchanged or begin anew. So they are where only one of two that cross is seen for longer than two cycles;
places and forces never change by it. Two touches that turn back within a cycle or two are taken for two that
crossed.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from skinbus.arrays import Bools, Floats, Ints
from skinbus.estimate.baseline import EXPLAINED
from skinbus.estimate.contacts import Contacts
from skinbus.model import Arm
from skinbus.model.validation import check_arm, check_fresh, check_time

Rows = npt.NDArray[Any]

MAX_TRACKS = 64
"""Most tracks, and most contacts of a cycle that are looked at (the strongest); the wire shows 16."""
N_IDS = 255
"""Identities on the wire are one byte; 0 is none."""

# --- Measurement -----------------------------------------------------------------------------------
UNKNOWN, LEAST, MOST = np.array([[2e-3, 2e-3, 0.5], [1e-4, 1e-4, 0.01], [25e-3, 25e-3, 10.0]]) ** 2
"""Variances of s, a (m^2) and force (N^2): of a contact without covariance, K-means errs by 1-4 mm and 7-18 %
of some newtons; the least of one with covariance, a count on the wire; the most, and that after a restart,
half a patch: a contact is known to be on its patch."""
FAR = 1e4
"""s, a (m) and forces (N) beyond are no contacts."""

# --- Motion ----------------------------------------------------------------------------------------
ACCELERATION = np.array([[0.01], [0.01], [0.0]])
"""White acceleration of s, a and none of the force, m^2/s^3: 14 mm/s of change in 20 ms, as of a sliding hand
(0.7 m/s^2)."""
WALK = 100.0
"""Random walk of the force, N^2/s: 1.4 N in 20 ms."""
SIGMA_SPEED = 0.7
"""Speed of a contact that has just come, m/s: a hand that wipes has 1."""

# --- Association -----------------------------------------------------------------------------------
FASTEST = 1.1
"""A contact is that of a track if it has moved no faster since that was seen, m/s, or within REACH."""
REACH, MERGE_REACH = 20e-3, 40e-3
"""A contact is that of a track within two pitches of where that was seen or is expected, m, as estimates at
seams jump by one, and fingers that lift and touch in turn are further apart; further at low rates. Two within
four pitches, where one of them is in a gap, may be seen as one."""

# --- Life ------------------------------------------------------------------------------------------
COAST_CYCLES = 2
"""Cycles that a track may miss for no reason."""
MERGE_SHARE = 0.2
"""Share of the hidden contact's force that the common one must show over that of the other."""
GAP = (1.0, 1.6)
"""A place so far from all tactels is in a gap, pitches: nearer ones feel a finger of 2 N; the middle of a
corner of four boards is 1.5 away, and what is further is off the skin."""
SPEED_MOVE = 0.02
"""A contact faster than this moves, m/s, if it is also three sigmas of the speed."""

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
    link, patch index of the link, and of the patch it was on when last seen
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


def _record(columns: dict[str, str]) -> np.dtype[Any]:
    """Return the type of rows with these columns: kinds, as numpy names them, and names by spaces."""
    return np.dtype([(name, kind) for kind, names in columns.items() for name in names.split()])


TRACK = _record(
    {
        "i8": "identity id slot state row link patch born_ns seen_ns missed",
        "b1": "doubted shared is_hidden moving",
        "f8": "s a force",
        "(3,2)f8": "mean",
        "(3,3)f8": "covariance",
    }
)
"""A track; its public columns are those of :class:`Tracks`.

mean       s, a and force, each with its speed
missed     cycles since it was seen
is_hidden  it may be a part of the contact of another track, which is ...
shared     ... this one
doubted    the last contact was off its line, and not taken in
"""
CONTACT = _record({"i8": "link patch row track age_ns", "3f8": "z r"})
"""A contact of this cycle, its row and the track it went to, -1 for none; z is s, a, force, r their
variances."""
_PUBLIC = [field.name for field in fields(Tracks) if field.name in set(TRACK.names or ()) - {"mean"}]


class Tracker:
    """Gives the contacts of an arm identities over cycles.

    ``n_slots``  places that can be shown; more tracks than that are kept, up to 64
    ``blind_s``  longest time that a track may be unseen, s
    """

    def __init__(self, arm: Arm, *, n_slots: int = 16, blind_s: float = 1.0) -> None:
        check_arm(arm)
        self.arm = arm
        self._slots, self._blind_ns = np.arange(n_slots), round(1e9 * blind_s)
        self._pitch = np.array([placed.patch.pitch for placed in arm.patches])[arm.tactel_patch]
        self._radius, self._taper, self._period, self._length = arm.link_shapes.T
        self._turn = np.where(self._period > 0.0, self._period, 1.0)
        self._waiting: list[tuple[KeptTrack, float]] = []
        self.last = (0, 0)
        """The identity and the number that were given last."""
        self.reset()

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
        self._waiting.append((track, within_s))

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
        c = _usable(contacts)
        c["age_ns"] = np.broadcast_to(age_ns, flags.shape)[c["patch"]]
        dt = self._begin(t_ns, flags)
        if len(self._tracks):
            away = self._pair(c, t_ns)
            for k in np.flatnonzero(self._tracks["row"] < 0).tolist():
                self._miss(k, c, away[k], t_ns, flags)
            self._take(c, dt, t_ns)
        self._spawn(c, t_ns)

        w, contact_row = self._tracks, np.full(len(contacts), -1, np.int64)
        contact_row[c["row"]] = c["track"]
        mean = w["mean"][:, [0, 1, 0, 1, 2], [0, 0, 1, 1, 0]]
        columns = {name: w[name].copy() for name in _PUBLIC}
        columns["row"] = np.append(c["row"], -1)[w["row"]]
        return Tracks(t_ns=t_ns, mean=mean, contact_row=contact_row, **columns)

    def _begin(self, t_ns: int, fresh: Bools) -> float:
        """Carry the tracks that were not lifted on to a cycle; return the step, s."""
        dt_ns = 0 if self._last_ns is None else t_ns - self._last_ns
        self._last_ns, dt = t_ns, 1e-9 * max(dt_ns, 0)
        self._tracks = w = self._tracks[self._tracks["state"] != LIFT]
        if dt_ns < 0:  # the clock was set back: everything that was remembered goes with it
            w["born_ns"] += dt_ns
            w["seen_ns"] += dt_ns
        waiting = [(track, left_s - dt) for track, left_s in self._waiting if left_s >= dt]
        self._waiting = [entry for entry in waiting if not fresh[entry[0].patch]]
        for track, _ in waiting:
            if fresh[track.patch] and track.id not in self._tracks["id"]:
                slot = -1 if track.slot in self._tracks["slot"] else track.slot
                self._put(t_ns, np.array([track[-3:]]), MOST, **track._replace(slot=slot)._asdict())
        w = self._tracks
        w["row"], w["shared"] = -1, False
        w["missed"] += 1
        w["mean"][:, :, 0] += dt * w["mean"][:, :, 1]
        q = ACCELERATION * [dt**3 / 3.0, dt**2 / 2.0, dt]
        q[2, 0] = WALK * dt
        w["covariance"] = w["covariance"] @ [[1.0, 0.0, 0.0], [2.0 * dt, 1.0, 0.0], [dt * dt, dt, 1.0]] + q
        return dt

    def _pair(self, c: Rows, t_ns: int) -> Floats:
        """Pair tracks with contacts; return how far those are from where tracks were expected, m.

        Both are (n_tracks, n_contacts).
        """
        w = self._tracks
        link, unseen_ns = w["link"][:, None], t_ns - w["seen_ns"][:, None]
        age, x = 1e-9 * c["age_ns"], w["mean"][:, :, None]
        expected = x[..., 0] - age * x[..., 1]
        away = self._distance(c, link, expected[:, 0], expected[:, 1])
        away[(link != c["link"]) | (unseen_ns > self._blind_ns)] = np.inf
        # one that has turned or begun to move is where it was, not where it was expected
        still = self._distance(c, link, w["s"][:, None], w["a"][:, None])
        still[np.isinf(away) | w["is_hidden"][:, None]] = np.inf
        cost = (np.minimum(away, still) / np.clip(FASTEST * 1e-9 * unseen_ns, REACH, MERGE_REACH)) ** 2
        i, j = linear_sum_assignment(np.where(cost <= 1.0, cost, MAX_TRACKS))
        is_pair = cost[i, j] <= 1.0
        i, j = i[is_pair], j[is_pair]
        w["row"][i], c["track"][j] = j, i
        return away

    def _distance(self, c: Rows, link: Ints, s: Floats, a: Floats) -> Floats:
        """Return how far contacts are from places of links, m."""
        ratio = 1.0 + self._taper[link] * (s - 0.5 * self._length[link]) / self._radius[link]
        return np.asarray(np.hypot(c["z"][:, 0] - s, ratio * self._wrap(c["z"][:, 1] - a, link)))

    def _wrap(self, a: Floats, link: Ints) -> Floats:
        """Return a (m) on links within half a turn of 0."""
        return np.asarray(a - self._period[link] * np.rint(a / self._turn[link]))

    def _miss(self, k: int, c: Rows, away: Floats, t_ns: int, fresh: Bools) -> None:
        """Decide for a track without a contact why that is, and whether it has ended."""
        w, arm = self._tracks, self.arm
        t, by, other = w[k], c["track"], w[c["track"]]
        (s, a, force), unseen_ns = t["mean"][:, 0], t_ns - t["seen_ns"]
        # a contact near and strong enough to be that of both; two that meet have both been there before
        is_both = (by >= 0) & (away <= MERGE_REACH) & (other["born_ns"] <= t["seen_ns"])
        is_both &= c["z"][:, 2] >= other["mean"][:, 2, 0] + MERGE_SHARE * force
        t["is_hidden"] = is_both.any()
        if t["is_hidden"]:
            w["shared"][by[np.where(is_both, away, np.inf).argmin()]] = True
        d = arm.links[t["link"]].surface.distance(arm.tactel_s, arm.tactel_a, s, a)
        d = np.where((arm.tactel_link == t["link"]) & arm.tactel_healthy, d, np.inf)
        is_read = fresh[t["patch"]] and fresh[arm.tactel_patch[d.argmin()]]
        in_gap = t["moving"] and GAP[0] < (d / self._pitch).min() <= GAP[1]
        is_over = t["missed"] > COAST_CYCLES and is_read and not (in_gap or t["is_hidden"])
        t["state"] = LIFT if is_over or unseen_ns > self._blind_ns else COAST

    def _take(self, c: Rows, dt: float, t_ns: int) -> None:
        """Take in what tracks are seen as; correct the filters of those that do not share their contact."""
        w = self._tracks
        (i,) = np.nonzero(w["row"] >= 0)
        c = c[w["row"][i]]
        z, age, x, p = c["z"], 1e-9 * c["age_ns"][:, None], w["mean"][i], w["covariance"][i]
        off = z - x[..., 0] + age * x[..., 1]
        off[:, 1] = self._wrap(off[:, 1], c["link"])
        common = p[..., :2] - age[..., None] * p[..., 1:]  # of value and speed with what is seen
        variance = common[..., 0] - age * common[..., 1] + c["r"]
        is_off, doubted = (off**2 / variance)[:, :2].mean(axis=1) > EXPLAINED**2, w["doubted"][i]
        takes = ~w["shared"][i] & (dt > 0.0)
        gain = common / variance[..., None] * (takes & (~is_off | doubted))[:, None, None]
        x += gain * off[..., None]
        p -= gain[..., [0, 0, 1]] * common[..., [0, 1, 1]]
        x[:, 1, 0] = self._wrap(x[:, 1, 0], c["link"])
        least2 = np.maximum(SPEED_MOVE**2, EXPLAINED**2 * p[:, :2, 2].max(axis=1))
        # held again below half of that
        moving = (x[:, :2, 1] ** 2).sum(axis=1) > least2 * np.where(w["moving"][i], 0.25, 1.0)
        w["s"][i], w["a"][i], w["force"][i] = z.T
        w["patch"][i], w["seen_ns"][i] = c["patch"], t_ns - c["age_ns"]
        w["missed"][i], w["is_hidden"][i] = 0, False
        w["mean"][i], w["covariance"][i], w["moving"][i] = x, p, moving
        w["doubted"][i] = np.where(takes, is_off & ~doubted, doubted)
        w["state"][i] = np.where(moving, MOVE, HELD)

    def _spawn(self, c: Rows, t_ns: int) -> None:
        """Begin a track for contacts that have none, the strongest first; give free slots to the oldest."""
        n, (identity, last) = len(self._tracks), self.last
        new = np.flatnonzero(c["track"] < 0)[: MAX_TRACKS - n]
        if len(new):
            ids = (last + np.arange(N_IDS)) % N_IDS + 1
            ids = ids[~np.isin(ids, self._tracks["id"])][: len(new)]
            identities = identity + 1 + np.arange(len(new))
            self.last = int(identities[-1]), int(ids[-1])
            own = {"identity": identities, "id": ids, "slot": -1, "state": TOUCH, "row": new}
            place = {name: c[name][new] for name in ("link", "patch")}
            self._put(t_ns - c["age_ns"][new], c["z"][new], c["r"][new], **own, **place)
            c["track"][new] = n + np.arange(len(new))
        w = self._tracks
        (i,) = np.nonzero((w["slot"] < 0) & (w["row"] >= 0))
        if len(i):
            free = np.setdiff1d(self._slots, w["slot"])[: len(i)]
            w["slot"][i[: len(free)]], w["state"][i[: len(free)]] = free, TOUCH

    def _put(self, t_ns: Any, z: Floats, variance: Floats, **columns: Any) -> None:
        """Begin tracks where they were seen last, with variances of s, a and force; no speed is known."""
        t = np.zeros(len(z), TRACK)
        for name, value in columns.items():
            t[name] = value
        t["born_ns"] = t["seen_ns"] = t_ns
        t["s"], t["a"], t["force"] = z.T
        t["mean"][:, :, 0], t["covariance"][:, :, 0], t["covariance"][:, :2, 2] = z, variance, SIGMA_SPEED**2
        self._tracks = np.append(self._tracks, t)


def _usable(contacts: Contacts) -> Rows:
    """Return the contacts that can be used, the strongest first, in whatever order they come."""
    z = np.array([contacts.s, contacts.a, contacts.force]).T
    is_usable = (np.abs(z) < FAR).all(axis=1) & (z[:, 2] >= 0.0)  # false for NaN
    order = np.lexsort((z[:, 1], z[:, 0], contacts.link, -z[:, 2]))
    rows = order[is_usable[order]][:MAX_TRACKS]
    c = np.zeros(len(rows), CONTACT)
    c["link"], c["patch"] = contacts.link[rows], contacts.patch[rows]
    c["row"], c["track"], c["z"] = rows, -1, z[rows]
    variance = contacts.covariance[rows].diagonal(axis1=1, axis2=2)
    is_known = ((variance > 0.0) & (variance < np.inf)).all(axis=1, keepdims=True)
    c["r"] = np.clip(np.where(is_known, variance, UNKNOWN), LEAST, MOST)
    return c
