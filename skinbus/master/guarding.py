"""The guard of one bus: limits from zeros and gains to counts, written to patches, and right as zeros move.

A patch is beyond the limits of the arm file when a tactel reads more than P, or the sum of area times
pressure (areas as ``estimate.loads`` has them) is more than F. It compares counts::

    r_j > z_j + P_j / k_j                       k: Pa per count, gain included
    sum_j w_j (r_j - z_j) > W                   z: counts at no pressure: offset and followed zero
    w_j = W max_F (A_j / F) k_j                 W: so that the largest weight is MAX_WEIGHT

P and F are those of the regions of a tactel, times their transient factors. Tactels of several regions on one
patch share its sum: it is exceeded where the load of a region is, and earlier where more than one is loaded.
A limit that zeros move beyond full scale is full scale: one that no reading exceeds would be none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.arrays import Bools, Floats
from skinbus.can.event import Event, EventKind
from skinbus.estimate import Baseline, Plausibility
from skinbus.master.commissioning.sessions import Script
from skinbus.master.patches.provisioning import write_back
from skinbus.master.patches.table import Mask, PatchTable
from skinbus.model import Arm
from skinbus.node.device import Device
from skinbus.objects.cia import EmcyCode
from skinbus.objects.guard import MAX_WEIGHT, NO_LIMIT, GuardLimits
from skinbus.objects.profile import GUARD_LIMITS, has, index_of

FOLLOWED = 0.02
"""Share of a limit by which it may be off until it is written anew: gains are not known better."""
DIFFERENT = 0.05
"""The same from which on a patch is not guarding: what drifts while a rewrite waits for others is less."""
ROOM_LEAST = 1.0 / FOLLOWED
"""Counts that a limit counts as, at least, in these shares: what is less than a count is not followed."""
RETRY_NS = 1_000_000_000
"""From one rewrite of a patch to the next: one that fails is not repeated at once."""
NEWS_NS = 1_000_000_000
"""Between two reports: what comes and goes does not fill the bus."""
NAMED = 8
"""Patches that a report names at most."""
NO_SUM = (1 << 31) - 1
"""No sum is above it."""


class Guarding:
    """Writes the limits of the patches on a bus, one after another, and says which of them do not guard.

    Columns are of the patches or tactels on the bus.
    """

    def __init__(
        self,
        arm: Arm,
        number: int,
        ods: Sequence[ObjectDictionary],
        areas: Floats,
        table: PatchTable,
        baseline: Baseline,
        plausibility: Plausibility,
    ) -> None:
        """``number`` is that of the bus.

        ods:    of all patches
        areas:  (n_tactels,) m^2 by which pressures are multiplied in a sum
        table:  of all patches
        """
        assert arm.guard
        self._n, self._m = arm.guard.n, arm.guard.m
        own = arm.patches_on(number)
        self._table, self._baseline, self._plausibility = table.part(own), baseline, plausibility
        self._here = here = slice(*arm.patch_start[[own.start, own.stop]].tolist())
        self._first = arm.patch_start[own] - here.start
        self._patch = arm.tactel_patch[here] - own.start
        transducers = [placed.patch.transducer for placed in arm.patches[own]]
        step, top = ([getattr(t, name) for t in transducers] for name in ("step", "clipped_counts"))
        self._scale = np.array(step)[self._patch] * arm.tactel_gain[here]
        self._offset, self._top = arm.tactel_offset[here], np.floor(top)[self._patch]
        pressure, share = np.full(len(self._patch), np.inf), np.zeros(len(self._patch))
        for region in arm.guard.regions:
            inside = region.tactels[here] & arm.tactel_healthy[here]
            least, most = region.transient_factor * np.array([region.pressure, region.force])
            pressure[inside] = np.minimum(pressure[inside], least)
            share[inside] = np.maximum(share[inside], areas[here][inside] / most)
        self._room = pressure / self._scale  # counts from the zero to the limit
        per_count = share * self._scale
        self._unit = MAX_WEIGHT / np.maximum(np.maximum.reduceat(per_count, self._first), 1e-300)
        self._weights = np.rint(per_count * self._unit[self._patch])
        self._is_limited = np.isfinite(pressure) | (self._weights > 0.0)
        self._guards = self._by_patch(self._is_limited)
        self._node_ids = arm.node_id[own]
        self._address = [index_of(od, GUARD_LIMITS) if has(od, GUARD_LIMITS) else (0, 0) for od in ods[own]]
        self.indices = frozenset(index for index, _ in self._address)
        """Of the objects that hold the limits."""
        n = len(self._guards)
        self._held = np.full(len(self._patch), np.nan)  # counts at no pressure when limits were written
        self._off, self._tried_ns = np.full(n, np.inf), np.zeros(n, np.int64)
        self._lacking, self._next_ns = np.zeros(n, np.bool_), 0

    def limits(self, p: int) -> GuardLimits:
        """Return the limits of patch p by its zeros now."""
        return self._limits(p, self._counts())

    def _counts(self) -> Floats:
        """Return what tactels read at no pressure, (n_tactels,) counts."""
        return np.asarray(self._offset + self._baseline.felt.zero[self._here] / self._scale)

    def _limits(self, p: int, counts: Floats) -> GuardLimits:
        own = self._patch == p
        zeros, top, room, weights = counts[own], self._top[own], self._room[own], self._weights[own]
        total = math.floor(min(self._unit[p] + weights @ zeros, weights @ top)) if weights.any() else NO_SUM
        limits = np.where(np.isfinite(room), np.floor(np.minimum(zeros + room, top)), NO_LIMIT)
        return GuardLimits(self._n, self._m, total, limits.astype(np.int64), weights.astype(np.int64))

    def write(self, p: int) -> Script[None]:
        """Write the limits of patch p and read them back, if it is to guard."""
        if self._guards[p]:
            counts, own = self._counts(), self._patch == p
            self._held[own] = np.nan
            yield from write_back("guard limits", *self._address[p], self._limits(p, counts).encode())
            self._held[own] = counts[own]

    def due(self, now_ns: int) -> int | None:
        """Return the patch whose limits are to be written anew, if there is one; none while it is touched."""
        touched = self._by_patch(self._baseline.felt.touched[self._here] != 0)
        wanted = self._guards & self._table.is_running & ~(self._off <= FOLLOWED) & ~touched
        wanted &= now_ns - self._tried_ns >= RETRY_NS
        if not wanted.any():
            return None
        p = int(wanted.argmax())
        self._tried_ns[p] = now_ns
        return p

    def show(self, now_ns: int, device: Device) -> list[Event]:
        """Compare limits with zeros; report which patches do not guard, when others do not than before.

        ``device`` is the node of the master on the bus.
        """
        moved = self._counts() - self._held
        share = np.where(self._is_limited, np.abs(moved) / np.maximum(self._room, ROOM_LEAST), 0.0)
        total = np.abs(np.add.reduceat(self._weights * moved, self._first)) / self._unit
        self._off = np.maximum(total, np.maximum.reduceat(share, self._first))
        is_blind = self._by_patch(self._is_limited & (self._plausibility.faults[self._here] != 0))
        guards = self._table.is_running & (self._off <= DIFFERENT) & ~is_blind
        lacking = self._guards & ~guards
        if now_ns < self._next_ns or np.array_equal(lacking, self._lacking):
            return []
        self._lacking, self._next_ns = lacking, now_ns + NEWS_NS
        device.emcy_clear(EmcyCode.NOT_GUARDING)
        node_ids = self._node_ids[lacking].tolist()
        if not node_ids:
            return [Event(t_ns=now_ns, kind=EventKind.NOT_GUARDING_END)]
        device.emcy(EmcyCode.NOT_GUARDING, data=bytes([node_ids[0], len(node_ids)]))
        names = [str(node_id) for node_id in node_ids[:NAMED]] + ["..."] * (len(node_ids) > NAMED)
        detail = f"patches {', '.join(names)}"
        return [Event(t_ns=now_ns, kind=EventKind.NOT_GUARDING, count=len(node_ids), detail=detail)]

    def _by_patch(self, tactels: Bools) -> Mask:
        """Return which patches have a tactel of these."""
        return np.asarray(np.logical_or.reduceat(tactels, self._first))
