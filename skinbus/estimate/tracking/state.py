"""What the tracker works on: its constants, the surface as columns, and buffers made once."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.tracking.assignment import make_assign_work
from skinbus.estimate.tracking.filter import N
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

MAX_TRACKS: Final = 64
"""Most tracks, and most contacts of a cycle that are looked at (the strongest); the wire shows 16."""
N_IDS: Final = 255
"""Identities on the wire are one byte; 0 is none."""

# --- Measurement -----------------------------------------------------------------------------------
SIGMA_UNKNOWN: Final = 2e-3
"""Place error of a contact without covariance, m: K-means errs 1-4 mm (DESIGN section 4)."""
FORCE_UNKNOWN: Final = 0.1
"""Its force error, share of the force: K-means errs 7-18 %."""
SIGMA_FLOOR: Final = 1e-4
"""Least place error of a contact with covariance, m: one count on the wire."""
FORCE_FLOOR: Final = 0.01
"""Its least force error, share of the force, and N."""
SIGMA_CEILING: Final = 25e-3
"""Most place error, m: half a patch; a contact is known to be on its patch."""
CROWD: Final = 30e-3
"""Contacts with two tracks this close are crowded, m: their pressures overlap on three pitches."""
SIGMA_CROWD: Final = 4e-3
"""Place error of a crowded contact on top of its covariance, m: the worst of K-means (DESIGN section 4)."""
FORCE_CROWD: Final = 0.5
"""Its force error, share of the force: two that overlap are badly distinguished."""
CORRELATION_LIMIT: Final = 0.99
"""Correlations are scaled by this: what rounding has made singular is regular again."""

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
COST_NONE: Final = 60.0
"""Cost of leaving a pair apart: over GATE + FORCE_MOST + COST_HIDDEN + log det, which is at most 10."""
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

FREE, TOUCH, HELD, LIFT, COAST, MOVE = range(6)
"""States; the first five are those of the wire."""
SEEN, MISSED, BLIND, HIDDEN = range(4)
"""Why a track is not seen."""

LAST_IDENTITY, LAST_ID, LAST_T, STARTED = range(4)
"""Places in ``clock``."""


class Ground(NamedTuple):
    """The surface the tracks live on, per link and per patch."""

    link: Floats  # (n_links, 4), see ``kernels.geometry.LinkSurface``
    patch_link: Ints
    patch_s: Floats
    patch_a: Floats
    tactel: Floats  # (n_tactels, 4) link, s, a, pitch of its board; those that are not dead


class TrackWork(NamedTuple):
    """Buffers; m = MAX_TRACKS rows of tracks, and as many of contacts."""

    clock: Ints  # (4,)
    identity: Ints  # (m,) 64-bit, 0 where the row is free
    id: Ints  # (m,) 1..255 on the wire
    slot: Ints  # (m,) place on the wire, -1 for none
    slot_used: Bools  # (n_slots,)
    state: Ints  # (m,)
    why: Ints  # (m,)
    row: Ints  # (m,) contact of this cycle, -1 for none
    link: Ints
    patch: Ints  # (m,) patch that felt it most when it was last seen
    raw: Floats  # (m, 3) s, a, force as last seen
    born_ns: Ints
    seen_ns: Ints
    updated_ns: Ints  # (m,) last time the filter took a contact in
    shown_ns: Ints  # (m,) last time it was seen, or a contact was strong enough to be its too
    doubted: Bools  # (m,) the last contact was off its line, and not taken in
    missed: Ints  # (m,) cycles since it was seen
    hider: Ints  # (m,) track whose contact hides it, -1 for none
    shared: Bools  # (m,) its contact is that of hidden tracks too
    moving: Bools
    x: Floats  # (m, 5)
    U: Floats  # (m, 5, 5)
    D: Floats  # (m, 5)
    P: Floats  # (m, 5, 5)

    c_link: Ints  # (m,) contacts of this cycle
    c_patch: Ints
    c_quality: Ints
    c_z: Floats  # (m, 3)
    c_cov: Floats  # (m, 3, 3)
    c_track: Ints  # (m,) the track it went to, -1 for none
    c_usable: Bools
    c_crowded: Bools
    fresh: Bools  # (n_patches,)

    cost: Floats  # (m, m)
    live: Ints  # (m,) tracks that look for a contact
    list: Ints  # (m,) contacts that can be used
    row_price: Floats  # (m,) the buffers of ``assign``
    column_price: Floats
    shortest: Floats
    path: Ints
    row_done: Bools
    column_done: Bools
    column_of: Ints
    row_of: Ints

    R: Floats  # (3, 3) scratch of the filters
    y: Floats  # (3,)
    h: Floats  # (5,)
    gain: Floats
    dx: Floats
    W: Floats  # (5, 10)
    Dw: Floats  # (10,)


def make_ground(arm: Arm) -> Ground:
    """Return the columns of an arm that the tracker needs, as copies of one type each."""
    pitches = np.array([placed.patch.pitch for placed in arm.patches])
    columns = [arm.tactel_link, arm.tactel_s, arm.tactel_a, pitches[arm.tactel_patch]]
    return Ground(
        np.stack([arm.link_radius, arm.link_taper, arm.link_period, arm.link_length], -1),
        arm.patch_link.astype(np.int64),
        np.array(arm.patch_s),
        np.array(arm.patch_a),
        np.stack(columns, -1)[arm.tactel_healthy],
    )


def make_track_work(n_patches: int, n_slots: int) -> TrackWork:
    """Return zeroed buffers with every row free."""
    m = MAX_TRACKS

    def ints() -> Ints:
        return np.zeros(m, np.int64)

    def flags(size: int = m) -> Bools:
        return np.zeros(size, np.bool_)

    return TrackWork(
        clock=np.zeros(4, np.int64),
        identity=ints(),
        id=ints(),
        slot=np.full(m, -1, np.int64),
        slot_used=flags(n_slots),
        state=ints(),
        why=ints(),
        row=np.full(m, -1, np.int64),
        link=ints(),
        patch=ints(),
        raw=np.zeros((m, 3)),
        born_ns=ints(),
        seen_ns=ints(),
        updated_ns=ints(),
        shown_ns=ints(),
        doubted=flags(),
        missed=ints(),
        hider=np.full(m, -1, np.int64),
        shared=flags(),
        moving=flags(),
        x=np.zeros((m, N)),
        U=np.zeros((m, N, N)),
        D=np.zeros((m, N)),
        P=np.zeros((m, N, N)),
        c_link=ints(),
        c_patch=ints(),
        c_quality=ints(),
        c_z=np.zeros((m, 3)),
        c_cov=np.zeros((m, 3, 3)),
        c_track=ints(),
        c_usable=flags(),
        c_crowded=flags(),
        fresh=flags(n_patches),
        cost=np.zeros((m, m)),
        live=ints(),
        list=ints(),
        **make_assign_work(m)._asdict(),
        R=np.zeros((3, 3)),
        y=np.zeros(3),
        h=np.zeros(N),
        gain=np.zeros(N),
        dx=np.zeros(N),
        W=np.zeros((N, 2 * N)),
        Dw=np.zeros(2 * N),
    )
