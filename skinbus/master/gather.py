"""Gathering: the PDO frames of one SYNC cycle become readings, or are counted and dropped.

A cycle is open from its SYNC until all patches that owe readings have sent them, or until its deadline. What
comes later is late: it is counted, and its readings are in no cycle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinbus.arrays import Bytes, Ints
from skinbus.can.frame import FrameBatch
from skinbus.master.freshness import Freshness
from skinbus.master.patches.table import Mask
from skinbus.objects.profile import AGE_STEP_NS, SampleStatus
from skinbus.objects.readings import ReadingsPlan

UNUSABLE = SampleStatus.OLD | SampleStatus.UNSETTLED
"""Of a time that is not known, or of no pressure."""


@dataclass(slots=True)
class FrameCounters:
    """Data-plane frames since the start, by fate."""

    accepted: int = 0
    unknown: int = 0
    bad_length: int = 0
    late: int = 0
    """Frames that came when their cycle was closed."""
    missing: int = 0
    """Frames that a patch owed and that had not come by the next SYNC."""
    dropped: int = 0
    """Frames that the machine received and had no room for."""

    @property
    def lost(self) -> int:
        """Frames whose readings are in no cycle."""
        return self.late + self.missing + self.dropped


class Gather:
    """Collects the frames of the open cycle; works in arrays allocated once."""

    def __init__(self, plan: ReadingsPlan, n_tactels: int, freshness: Freshness, max_age_ns: int) -> None:
        """``freshness`` decides which frames answer the SYNC of their cycle; older samples are not used."""
        self.plan = plan
        self.counters = FrameCounters()
        self.counts = np.zeros(n_tactels, np.int32)
        """Newest counts of every tactel; stale where ``close`` says so."""
        n_patches = len(plan.expected)
        self.seen = np.zeros(n_patches, np.int32)
        """Bit k: the patch's TPDO k of this cycle has come, in time or late."""
        self.is_open = False
        self.has_news = False
        """Whether a patch has sent a change that was in no cycle yet."""
        self.freshness = freshness
        self._stamps = plan.new_stamps()
        self._max_age_ns = max_age_ns
        self.age_ns = np.zeros(n_patches, np.int64)
        """(n_patches,) from the oldest sample in the readings of a patch to the SYNC that they answer."""
        self.owing = np.zeros(n_patches, np.bool_)
        """Patches that are to send readings in this cycle, (n_patches,)."""
        self._owed = 0
        self._n_got = 0  # frames decoded since what is owed was last counted
        self._opened_ns = 0
        self._n_dropped = 0  # in this cycle

    @property
    def n_owed(self) -> int:
        """Frames that the open cycle waits for, at least."""
        return max(self._owed - self._n_got, 0) if self.is_open else 0

    @property
    def has_answered(self) -> Mask:
        """Return which patches have sent all readings of the newest cycle, in time or late, (n_patches,)."""
        return np.asarray(self.seen & self.plan.on_sync == self.plan.on_sync)

    @property
    def has_sent(self) -> Mask:
        """Return which patches have sent all TPDOs since the newest SYNC, for whichever, (n_patches,)."""
        return np.asarray((self.freshness.answers.came & self.plan.on_sync) == self.plan.on_sync)

    def open(self, now_ns: int, owing: Mask) -> None:
        """Begin a cycle that waits until the patches in ``owing`` (n_patches,) have sent all their TPDOs."""
        came = self.freshness.answers.came
        missed = self.owing * (self.plan.on_sync & ~came)
        # What the machine dropped is counted already.
        self.counters.missing += max(int(np.bitwise_count(missed).sum()) - self._n_dropped, 0)
        self._opened_ns = now_ns
        self.seen[:] = came[:] = 0
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
        """Decode data-plane frames with the stamps of their reception; older ones than the cycle are late.

        Frames of TPDOs that run freely are taken whenever they come.
        """
        if self.plan.has_free:
            free_ns = self.freshness.answers.free_ns
            n_free, has_changed = self.plan.unpack_free(batch, self.counts, self._stamps, free_ns)
            self.has_news |= has_changed
            self.counters.accepted += n_free
        n = batch.n
        if not self.is_open:
            self._take_late(n, batch)
            return
        if n and batch.t_ns[0] < self._opened_ns:
            n_late = int(np.searchsorted(batch.t_ns[:n], self._opened_ns))
            batch.n = n_late
            self._take_late(n_late, batch)
            batch.n = n
            batch.drop(n_late)
        if batch.n == 0:
            return
        accepted, unknown, bad_length = self.plan.unpack(
            batch, self.counts, self.seen, self._stamps, self.freshness.answers
        )
        self.counters.accepted += accepted
        self.counters.unknown += unknown
        self.counters.bad_length += bad_length
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

    def close(self) -> Mask:
        """End the cycle and return which patches are fresh: every TPDO came in answer to this SYNC."""
        self.is_open = self.has_news = False
        free_ns = self.freshness.answers.free_ns
        is_used, self.age_ns = judge_stamps(
            self.plan, self._stamps, free_ns, self._opened_ns, self._max_age_ns
        )
        return self.freshness.judge(self.has_answered & (self.plan.expected != 0) & is_used)

    def _take_late(self, n: int, batch: FrameBatch) -> None:
        """Count n frames of a closed cycle, those in the batch: they answer its SYNC, or one before."""
        self.counters.late += n
        seen = np.zeros_like(self.seen) if self.is_open else self.seen
        self.freshness.take_back(self.is_open)
        self.plan.unpack(batch, self.counts, seen, None, self.freshness.answers)
        self.freshness.take_back(-self.is_open)

    def _missing(self) -> int:
        return int(np.bitwise_count(self.plan.on_sync[self.owing] & ~self.seen[self.owing]).sum())


def judge_stamps(
    plan: ReadingsPlan, stamps: Bytes, free_ns: Ints, now_ns: int, max_age_ns: int
) -> tuple[Mask, Ints]:
    """Return whether the newest readings of each patch may be used, by what it says, and their ages (ns).

    Both (n_patches,). What comes by a timer alone is older by the time since then, what is sent on a
    change is not. Those that have not come in time are not used, nor is what says that it is old.

    Args:
        stamps:     as of ``plan.unpack``.
        free_ns:    (n_frames,) when TPDOs that run freely came, 0 for never.
        max_age_ns: what is older is not used.
    """
    of_patch, is_used = np.zeros(plan.n_patches, np.int64), np.ones(plan.n_patches, np.bool_)
    if not (plan.has_free or plan.stamped.any()):
        return is_used, of_patch
    since_ns = np.maximum(now_ns - free_ns, 0) * plan.free
    age_ns = stamps[:, 2:] @ (1, 256) * AGE_STEP_NS + since_ns * ~plan.on_change[plan.pdo_patch]
    is_bad = (stamps[:, 1] & UNUSABLE != 0) | (plan.free & (free_ns == 0)) | (since_ns > plan.pause_ns)
    np.maximum.at(of_patch, plan.pdo_patch, age_ns)
    is_used[plan.pdo_patch[is_bad]] = False
    return is_used & (of_patch <= max_age_ns), of_patch
