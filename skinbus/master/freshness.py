"""Freshness: whether the readings of a patch answer the SYNC of their cycle, established and not assumed.

A classic PDO carries no cycle number, so answers are counted (``Answers``): each TPDO answers each SYNC
once, in their order. A patch that is late by more than a period is then behind for ever, however steady it
is, and one of which a frame was lost appears to be. A gap separates the two: one SYNC is left out. A patch
that has answered all sends nothing in the second period of the gap, and its account starts anew; one that is
late sends there what it still owed. A step in the phase of the SYNC would cost no cycle, but moves an answer
by less than frames move by queueing on a full bus.

A gap costs all patches a cycle. So while most answer as they should, those that are behind are stopped
instead, and booted when nothing of theirs is under way: they alone are missing. The first time after a
second without trouble that is done at once, and again with growing pauses. SYNCs that a full queue
discarded, or sent much later, leave an account that says nothing, as does a patch that was started while it
sent: it is used once a gap has proven it. For a second after a queue was full no gap is put off.
"""

from __future__ import annotations

import numpy as np

from skinbus.master.patches.table import SILENT, Mask, PatchTable
from skinbus.objects.readings import ReadingsPlan

GAP = 2
"""Periods between the SYNCs around a gap, and without a frame of a patch of which nothing is under way."""

CALM_NS = 1_000_000_000
"""For so long a patch must have answered each SYNC once before a gap is made for it, unless it is the first;
and for so long it is not used after frames that answer no SYNC: two boards at least differ now and then."""

LONGEST_NS = 30_000_000_000
"""Longest pause between gaps for one patch: 0.1 % of the cycles at 30 Hz."""

SPACING_NS = 500_000_000
"""Least time between two gaps, whatever they are for: they take one cycle in 25 at 50 Hz."""

UNAIDED = 3
"""Periods for which one that follows waits for the gap that the master would make, before it does without."""

LEAST_OVERFLOW = 100
"""Of the SYNC counter (0x1019), that its stamps prove anything: with less it has come round when frames come
that are late by so many periods. By 100 no board is late that keeps its heartbeat."""

MAX_DUE = 1_000_000
"""SYNCs counted as unanswered at most: more than the frames of a cycle, so that none of them is an answer."""

BABBLE = 3
"""Frames in a cycle, over the TPDOs of a patch, beyond which a node babbles: a second board makes it
two, a late answer three."""

STILL_NS = 200_000_000
"""For so long a patch is not used after a babbling node has sent under its identifiers: a hundred times the
mean time between such frames at 50 Hz."""


class Freshness:
    """Keeps the account of all patches; one for a master that produces the SYNC, or one that follows."""

    def __init__(
        self, plan: ReadingsPlan, period_ns: int, *, follows: bool = False, overflow: int = 0
    ) -> None:
        """With ``follows`` the gaps are another master's, if it makes any; ``overflow`` is 0x1019."""
        n = plan.n_patches
        self.answers = plan.answers()
        self._plan = plan
        self._n_pdos = np.bitwise_count(plan.on_sync).astype(np.int32)
        self._period_ns = period_ns
        self._follows = follows
        self._has_stamps = overflow >= LEAST_OVERFLOW
        self._opened_ns = self._gap_ns = -LONGEST_NS
        self._is_quiet = True
        # by patch: it had not answered all earlier SYNCs when the newest one came; frames of no SYNC,
        # as of a second board, came in the cycle before, and in another one a second ago at most
        self.is_behind, self.is_doubled = np.zeros((2, n), np.bool_)
        self.is_late = np.zeros(n, np.bool_)
        """(n_patches,) patches that are to be stopped: they have not answered all SYNCs, most others have."""
        # it was doubled, or a node babbled, and it has not shown since that it is not; what its account says
        # is not proven before a gap, or a start
        self._was_doubled, self._is_babbled, self._unproven = np.zeros((3, n), np.bool_)
        self._was_answering, self._was_silent, self._forgotten = np.zeros((3, n), np.bool_)
        # how often it began to run, and when last; when a gap may be made, until when it is unusable, and
        # until when no gap is put off; newest trouble, pause before the next gap
        self._starts, self.started_ns = np.zeros((2, n), np.int64)
        self._ready_ns, self._unusable_ns, self._eager_ns = np.zeros((3, n), np.int64)
        self._trouble_ns, self._wait_ns = np.full(n, -LONGEST_NS), np.full(n, CALM_NS)

    def open(self, now_ns: int, answering: Mask, counter: int = 0) -> bool:
        """Count a SYNC for the patches in ``answering`` (n_patches,); return whether to skip the next.

        ``counter`` is that of the SYNC, 0 for none.
        """
        answers = self.answers
        has_changed = answering.tobytes() != self._was_answering.tobytes()
        is_trivial = self._is_quiet and not has_changed and bool(answering.all())
        is_trivial = is_trivial and answers.n_frames.tobytes() == self._n_pdos.tobytes()
        wants_gap = False
        if not is_trivial:
            started = answering & ~self._was_answering
            answers.n_excess[~self._was_answering] = 0  # nothing was counted
            self._was_answering = answering.copy()
            self._settle(now_ns, answering, started)
            wants_gap = not self._follows and self._plan_gap(now_ns, answering)
        due = answers.due
        due += answering[self._plan.pdo_patch]
        np.minimum(due, MAX_DUE, out=due)
        answers.n_frames[:] = 0
        answers.n_excess[:] = 0
        answers.counter[0] = counter if self._has_stamps else 0
        self._opened_ns = now_ns
        return wants_gap

    def forget(self, patches: Mask) -> None:
        """Expect nothing of these patches (n_patches,) and of those of the last call before the next SYNC."""
        self.answers.due[(patches | self._forgotten)[self._plan.pdo_patch]] = 0
        self._forgotten = patches

    def started(self, now_ns: int, table: PatchTable) -> None:
        """Expect nothing before the next SYNC of patches that have begun to run since the last call.

        Of one that has sent readings since its boot-up message, and just now, some may be under way.
        What patches that run freely sent before they fell silent does not hold any more.
        """
        starts, last_ns = table.starts, self.answers.last_ns
        anew = starts != self._starts
        is_silent = table.state == SILENT
        gone = anew | is_silent & ~self._was_silent
        self._was_silent = is_silent
        self.answers.free_ns[gone[self._plan.pdo_patch]] = 0
        if anew.any():
            sends = (last_ns > table.last_boot_up) & (now_ns - last_ns < GAP * self._period_ns)
            self._unproven[anew] = sends[anew] & (not self._follows)
            self.answers.due[anew[self._plan.pdo_patch]] = 0
            self._starts = starts.copy()
            self.started_ns[anew] = now_ns

    def bus_is_back(self, now_ns: int, patches: slice) -> None:
        """Put off no gap for these patches in the next second: their bus has recovered."""
        self._eager_ns[patches] = now_ns + CALM_NS

    def sync_was_lost(self, now_ns: int, patches: slice) -> None:
        """Take back the newest SYNC for these patches, and what their account says.

        A queue that discards one SYNC may have sent others late.
        """
        self.bus_is_back(now_ns, patches)
        self._unproven[patches] = not self._follows
        self.answers.due[self._unproven[self._plan.pdo_patch]] = MAX_DUE
        self._is_quiet = False

    def take_back(self, n: int) -> None:
        """Count the newest SYNC n times less: for frames that came before it."""
        due = self.answers.due
        due -= n * self._was_answering[self._plan.pdo_patch]

    def judge(self, complete: Mask) -> Mask:
        """Return which of the patches that are complete (n_patches,) may be used.

        Not those that were behind when the cycle began: answers to two SYNCs in one cycle may be swapped.
        """
        if self._is_quiet and not self.answers.n_excess.any():
            return complete
        usable = (self.answers.n_excess == 0) & (self._unusable_ns <= self._opened_ns)
        return np.asarray(complete & usable & ~self.is_behind)

    def _settle(self, now_ns: int, answering: Mask, started: Mask) -> None:
        """Close the account of the cycle before."""
        answers, plan = self.answers, self._plan
        anew = (started | ~answering) & ~self._unproven
        clean = answers.n_frames == self._n_pdos
        if self._follows:
            patience_ns = SPACING_NS + UNAIDED * self._period_ns
            anew |= self.is_behind & clean & (self._ready_ns + patience_ns < now_ns)
        was_gap = now_ns - self._opened_ns > 1.5 * self._period_ns  # made here or by a late process
        if was_gap:
            is_calm = answers.last_ns <= self._opened_ns + self._period_ns
            anew |= is_calm & clean & (self._ready_ns <= self._opened_ns)
            self._unproven &= ~anew
        answers.due[anew[plan.pdo_patch]] = 0
        answers.due[self._unproven[plan.pdo_patch]] = MAX_DUE
        behind = plan.unanswered(answers) > 0
        new = behind & ~self.is_behind
        sudden = new & (now_ns - self._trouble_ns > CALM_NS)
        failed = behind & self.is_behind & clean & was_gap & (self._ready_ns <= self._opened_ns)
        in_vain = failed | new & (now_ns - np.maximum(self._gap_ns, self.started_ns) < CALM_NS)
        self._wait_ns[in_vain] = np.minimum(2 * self._wait_ns[in_vain], LONGEST_NS)
        later = now_ns + self._wait_ns
        put_off = ~sudden & (new | behind & ~clean & (answers.n_frames > 0))
        self._ready_ns[put_off] = later[put_off]
        self._ready_ns[sudden | behind & (now_ns < self._eager_ns)] = now_ns
        self._ready_ns[failed] = later[failed]
        self._trouble_ns[behind] = now_ns
        self._wait_ns[now_ns - self._trouble_ns > LONGEST_NS] = CALM_NS
        self.is_behind = behind
        in_excess = answers.n_excess > 0
        self._is_babbled |= answers.n_frames > BABBLE * self._n_pdos
        self.is_doubled = in_excess & self._was_doubled & ~self._is_babbled  # not by a single frame
        self._was_doubled |= in_excess
        self._unusable_ns[in_excess] = now_ns + np.where(self._is_babbled, STILL_NS, CALM_NS)[in_excess]
        self._was_doubled &= self._unusable_ns > now_ns
        self._is_babbled &= self._was_doubled
        self._is_quiet = not (behind.any() or self._was_doubled.any())

    def _plan_gap(self, now_ns: int, answering: Mask) -> bool:
        """Return whether this cycle is to be a gap; note who is to be stopped instead."""
        ready = self.is_behind & answering & (self.answers.n_frames > 0) & (self._ready_ns <= now_ns)
        needs_gap = ready & (self._unproven | (now_ns < self._eager_ns))
        if np.count_nonzero(ready) >= np.count_nonzero(answering & ~self.is_behind):
            needs_gap = ready
        self.is_late = ready & ~needs_gap
        if not needs_gap.any() or now_ns - self._gap_ns < SPACING_NS:
            return False
        self._gap_ns = now_ns
        return True
