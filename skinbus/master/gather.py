"""Gathering: the PDO frames of one SYNC cycle become readings, or are counted and dropped.

A cycle is open from its SYNC until all patches that owe readings have sent them, or until its
deadline. What comes while no cycle is open belongs to no SYNC: it is late, counted and dropped.

A classic PDO does not say of which SYNC it is. One that was missed may still be on its way, and come in
the next cycle as if it were of that: a patch that missed one is not believed in the cycle after.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skinbus.can.frame import FrameBatch
from skinbus.objects.readings import ReadingsPlan


@dataclass(slots=True)
class FrameCounters:
    """Data-plane frames since the start, by fate."""

    accepted: int = 0
    unknown: int = 0
    bad_length: int = 0
    late: int = 0
    """Frames that came when their cycle was closed."""
    missing: int = 0
    """Frames that a patch owed and that have not come, or that found no room."""
    dropped: int = 0
    """Frames that the machine received and had no room for."""

    @property
    def lost(self) -> int:
        """Frames whose readings are in no cycle; each is counted once."""
        return self.late + self.missing + self.dropped


class Gather:
    """Collects the frames of the open cycle; works in arrays allocated once."""

    def __init__(self, plan: ReadingsPlan, n_tactels: int) -> None:
        self.plan = plan
        self.counters = FrameCounters()
        self.counts = np.zeros(n_tactels, np.int32)
        """Newest counts of every tactel; stale where ``fresh`` says so."""
        n_patches = len(plan.expected)
        self.seen = np.zeros(n_patches, np.int32)
        """Bit k: the patch's TPDO k of this cycle has come."""
        self.bad_length = np.zeros(n_patches, np.int32)
        """(n_patches,) PDOs of wrong length since the start."""
        self.is_open = False
        # Decoding is compiled now, not in a cycle; to numba one row is another kind of array than many.
        batch = FrameBatch(2)
        for batch.n in (1, 2):  # rows of zeros, which are no readings
            plan.unpack(batch, self.counts, self.seen, self.bad_length)
        self.owing = np.zeros(n_patches, np.bool_)
        """Patches that are to send readings in this cycle, (n_patches,)."""
        self.doubtful = np.zeros(n_patches, np.bool_)
        """Patches whose readings may be those of the cycle before, (n_patches,)."""
        self._owed = 0
        self._n_got = 0  # frames decoded since what is owed was last counted
        self._opened_ns = 0
        self._n_dropped = 0  # in this cycle
        # Of the cycle closed last, and not come since: how many frames, and which, as in ``seen``.
        self._n_missing = 0
        self._missed = np.zeros(n_patches, np.int32)
        self._late_seen = np.zeros(n_patches, np.int32)
        self._late_counts = np.zeros(n_tactels, np.int32)  # of nobody's interest

    @property
    def n_owed(self) -> int:
        """Frames that the open cycle waits for, at least."""
        return max(self._owed - self._n_got, 0) if self.is_open else 0

    def open(self, now_ns: int, owing: npt.NDArray[np.bool_]) -> None:
        """Begin a cycle in which the patches in ``owing`` (n_patches,) are to send all their TPDOs."""
        self._opened_ns = now_ns
        self.doubtful = (self.owing | (self.seen != 0)) & (self.seen != self.plan.expected)
        self.seen[:] = 0
        self.owing = owing.copy()
        self._owed = self._missing()
        self._n_got = 0
        self._n_dropped = 0
        self.is_open = True

    def excuse(self, patches: slice) -> None:
        """Wait no longer for patches whose bus is gone."""
        self.owing[patches] = False
        self._owed = self._missing()

    def take(self, batch: FrameBatch) -> None:
        """Decode data-plane frames with the stamps of their reception; older ones than the cycle are late."""
        n = batch.n
        if not self.is_open:
            self._count_late(n, batch)
            return
        if n and batch.t_ns[0] < self._opened_ns:
            n_late = int(np.searchsorted(batch.t_ns[:n], self._opened_ns))
            batch.n = n_late
            self._count_late(n_late, batch)
            batch.n = n
            batch.drop(n_late)
        self._unpack(batch)
        self._n_got += batch.n

    def drop(self, n: int) -> None:
        """Count frames that the machine had no room for."""
        self.counters.dropped += n
        self._n_dropped += n

    def is_complete(self) -> bool:
        """Return whether every patch that owes readings has sent them all; counts only when it may be so."""
        if self._n_got >= self._owed:
            self._owed = self._missing()
            self._n_got = 0
        return self._owed == 0

    def close(self) -> npt.NDArray[np.bool_]:
        """End the cycle and return which patches are fresh: every TPDO came, and none is of another cycle."""
        # What the machine dropped is counted already.
        self._n_missing = max(self._missing() - self._n_dropped, 0)
        np.multiply(self.plan.expected & ~self.seen, self.owing, out=self._missed)
        self.counters.missing += self._n_missing
        self.is_open = False
        return np.asarray((self.seen == self.plan.expected) & (self.plan.expected != 0) & ~self.doubtful)

    def _count_late(self, n: int, batch: FrameBatch) -> None:
        """Count n frames of a closed cycle, those in the batch; those that it missed are missing no more."""
        self.counters.late += n
        if self._n_missing == 0:
            return
        self._late_seen[:] = 0
        self.plan.unpack(batch, self._late_counts, self._late_seen)
        self._late_seen &= self._missed
        self._missed ^= self._late_seen
        n_come = min(int(np.bitwise_count(self._late_seen).sum()), self._n_missing)
        self._n_missing -= n_come
        self.counters.missing -= n_come

    def _unpack(self, batch: FrameBatch) -> None:
        if batch.n == 0:
            return
        accepted, unknown, bad_length = self.plan.unpack(batch, self.counts, self.seen, self.bad_length)
        self.counters.accepted += accepted
        self.counters.unknown += unknown
        self.counters.bad_length += bad_length

    def _missing(self) -> int:
        return int(np.bitwise_count(self.plan.expected[self.owing] & ~self.seen[self.owing]).sum())
