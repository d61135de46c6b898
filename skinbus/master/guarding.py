"""The guard of one bus: limits in counts, written to patches, and written anew as zeros move.

A patch is beyond the limits of the arm file when a tactel reads more than P, or the sum of area times
pressure (areas as ``estimate.loads`` has them) is more than F. It compares counts::

    r_j > z_j + P_j / k_j                       k: Pa per count, gain included
    sum_j w_j max(r_j - z_j, 0) > W             z: counts at no pressure: offset and followed zero
    w_j = W max_F (A_j / F) k_j                 W: so that the largest weight is MAX_WEIGHT

P and F are those of the regions of a tactel, times their transient factors. Tactels of several regions on one
patch share its sum: it is exceeded where the load of a region is, and earlier where more than one is loaded.
A limit that zeros move beyond full scale is full scale: one that no reading exceeds would be none. So is that
of a tactel that has only a share of a force: at full scale nobody knows how much more it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from canopen.objectdictionary import ObjectDictionary

from skinbus.can.event import Event, EventKind
from skinbus.estimate.kernels.layout import limit_of
from skinbus.master.commissioning.sessions import Script
from skinbus.master.cycle import Cycle
from skinbus.master.patches.provisioning import write_back
from skinbus.master.patches.table import PatchTable
from skinbus.node.device import Device
from skinbus.objects.cia import EmcyCode
from skinbus.objects.guard import MAX_WEIGHT, NO_LIMIT, GuardLimits
from skinbus.objects.profile import GUARD_LIMITS, has, index_of

FOLLOWED = 0.02
"""Share of a limit by which it may be off until it is written anew: gains are not known better."""
DIFFERENT = 0.05
"""The same from which on a patch is not guarding: what drifts while a rewrite waits for others is less."""
STEPS_LEAST = 1.0 / FOLLOWED
"""Counts that a limit is taken for, at least, in these shares: less than a count is not followed."""
LOOK_NS = 1_000_000_000
"""Between two comparisons: zeros drift in minutes, and what comes and goes does not fill the bus."""
NO_SUM = (1 << 31) - 1
"""No sum is above it."""


class Guarding:
    """Writes the limits of the patches on a bus, one after another, and says which of them do not guard.

    Patches have the numbers of the bus, columns are those of the arm.
    """

    def __init__(self, cycle: Cycle, own: slice, ods: Sequence[ObjectDictionary], table: PatchTable) -> None:
        """``own`` are the patches on the bus; ``ods`` and ``table`` those of all."""
        arm, felt = cycle.arm, cycle.baseline.felt
        assert arm.guard
        self._arm, self._guard, self._own, self._table = arm, arm.guard, own, table
        self._zero, self._touched, self._faults = felt.zero, felt.touched, cycle.plausibility.faults
        self._has_zero = felt.known
        self._scale, self._full = cycle.scale, limit_of(arm)
        # Pa that each tactel may read, and what a pascal on it is of the force that may be
        self._most, self._share = np.full(arm.n_tactels, np.inf), np.zeros(arm.n_tactels)
        for region in arm.guard.regions:
            inside, factor = region.tactels & arm.tactel_healthy, region.transient_factor
            np.minimum(self._most, factor * region.pressure, out=self._most, where=inside)
            np.maximum(self._share, cycle.areas / (factor * region.force), out=self._share, where=inside)
        self._limited = np.isfinite(self._most) | (self._share > 0.0)
        self._address = [index_of(od, GUARD_LIMITS) if has(od, GUARD_LIMITS) else (0, 0) for od in ods[own]]
        self.indices = frozenset(index for index, _ in self._address)
        """Of the objects that hold the limits."""
        self._held = np.full(arm.n_tactels, np.nan)  # Pa, zeros by which limits were written
        # whether patches are to hold limits, and whether they do, where that is known
        self._may_guard, self._holds = np.zeros(arm.n_patches, np.bool_), np.full(arm.n_patches, np.nan)
        self.due: list[int] = []
        """Patches whose limits are to be written anew, since the last ``show``."""
        self._lacking, self._next_ns = np.zeros(len(self._address), np.bool_), 0

    def limits(self, p: int) -> GuardLimits:
        """Return the limits of patch p by its zeros now."""
        own = self._zero, self._most, self._share, self._limited, self._full
        columns = *own, self._scale, self._arm.tactel_offset
        here = self._arm.tactels_of(self._own.start + p)
        zero, most, share, limited, full, scale, offset = (column[here] for column in columns)
        unit = MAX_WEIGHT / max((share * scale).max(), 1e-300)
        weights = np.rint(unit * share * scale)
        rest = np.clip(np.floor(offset + zero / scale), -0x8000, 0x7FFF)
        total = weights @ (offset - rest) + min(unit + weights @ (zero / scale), weights @ (full / scale))
        limits = np.where(limited, offset + np.minimum(zero + most, full) / scale, NO_LIMIT)
        return GuardLimits(
            self._guard.n,
            self._guard.m,
            math.floor(total) if weights.any() else NO_SUM,
            np.floor(limits).astype(np.int64),
            weights.astype(np.int64),
            rest.astype(np.int64),
        )

    def write(self, p: int) -> Script[None]:
        """Write the limits of patch p and read them back, if it is to guard, or none if it may not."""
        first = self._own.start
        here, may = self._arm.tactels_of(first + p), bool(self._may_guard[first + p])
        if self._limited[here].any():
            zero, self._holds[first + p] = self._zero[here].copy(), np.nan
            yield from write_back("guard limits", *self._address[p], self.limits(p).encode() if may else b"")
            self._holds[first + p] = may
            if may:
                self._held[here] = zero

    def forget(self) -> None:
        """Write all limits anew: somebody may have written others."""
        self._holds[:] = np.nan

    def show(self, now_ns: int, device: Device) -> list[Event]:
        """Compare limits with zeros; report which patches do not guard, when others do not than before.

        ``device`` is the node of the master on the bus.
        """
        if now_ns < self._next_ns:
            return []
        self._next_ns = now_ns + LOOK_NS
        first, own, guarded = self._arm.patch_start[:-1], self._own, self._arm.guarded
        moved = self._zero - self._held
        share = np.abs(moved) / np.maximum(self._most, STEPS_LEAST * self._scale)
        total = np.add.reduceat(self._share * np.abs(moved), first)
        off = np.maximum(total, np.maximum.reduceat(np.where(self._limited, share, 0.0), first))
        is_touched = np.logical_or.reduceat(self._touched != 0, first)
        is_blind = np.logical_or.reduceat(self._limited & ((self._faults != 0) | ~self._has_zero), first)
        self._may_guard[:] = may = ~is_blind & ~(is_touched & (off > DIFFERENT))
        is_due = (self._holds != may) | (may & (off > FOLLOWED) & ~is_touched)
        self.due = np.flatnonzero((guarded & is_due)[own]).tolist()
        lacking = (guarded & ~(self._table.is_running & (self._holds == may) & may & (off <= DIFFERENT)))[own]
        if np.array_equal(lacking, self._lacking):
            return []
        self._lacking = lacking
        device.emcy_clear(EmcyCode.NOT_GUARDING)
        node_ids = self._arm.node_id[own][lacking].tolist()
        if not node_ids:
            return [Event(t_ns=now_ns, kind=EventKind.NOT_GUARDING_END)]
        device.emcy(EmcyCode.NOT_GUARDING, data=bytes([node_ids[0], len(node_ids)]))
        detail = f"patches {', '.join(map(str, node_ids))}"
        return [Event(t_ns=now_ns, kind=EventKind.NOT_GUARDING, count=len(node_ids), detail=detail)]
