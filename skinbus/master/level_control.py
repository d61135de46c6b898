"""How long a cycle may compute, and at which level, so that its contacts are out in time. Pure logic.

A cycle is in time when its contacts leave before the next SYNC is due. What is left for the estimator when
the readings are in is the rest of the period, less what publishing takes: its compute time, as measured in
the cycles before, and the contact TPDOs on the wire. A smaller budget may be asked for.

Level::

              strained in LOWER of the last WINDOW cycles
    full ──────────────────► fit ──────────────────► kmeans
         ◄──────────────────     ◄──────────────────
              calm for `wait` cycles in a row

A cycle is strained when its time ran out or its contacts were late, and calm when it needed at most
``CALM`` of its budget. ``wait`` begins with WAIT_LEAST cycles and doubles each time a raise proves to have
been too early, up to WAIT_MOST, so that a machine which cannot do it is not asked again and again; a raise
that lasts halves it. The same cycles give the same levels: no clock and no chance in here.
"""

from __future__ import annotations

from collections import deque
from enum import IntFlag

from skinbus.can.classic import worst_case_bits
from skinbus.estimate import LEVELS

WINDOW = 8
LOWER = 3
"""Strained cycles of the last WINDOW that lower the level: one is an accident, two a coincidence."""
CALM = 0.5
"""Share of the budget: a more expensive level takes at least as long again."""
WAIT_LEAST = 64
"""Cycles, 1.3 s at 50 Hz: longer than a tap, shorter than people wait for."""
WAIT_MOST = 4096
"""Cycles, 82 s at 50 Hz."""
FORGET = 0.02
"""Share by which the time of publishing, once large, is taken to be smaller in each cycle."""

REMEDY = "a larger budget, a lower rate_hz or a faster processor would help, see skinbus plan"

TPDO_BITS = worst_case_bits(8)


class CycleFlags(IntFlag):
    """Bits of "Cycle flags" in skin-master.eds; its two highest are the level, see :func:`with_level`."""

    INCOMPLETE = 1
    """A patch of the arm has no readings in this cycle, for whatever reason: its state says which."""
    OVERFLOW = 2
    """More contacts than contact objects."""
    OVERRUN = 4
    """Contacts were late, or SYNCs were left out before this cycle; "Overruns" has risen with it."""
    CUT_SHORT = 8
    """The estimator's time ran out: some contacts are of a cheaper level than that of the cycle."""
    LOWERED = 16
    """The level of the cycle is below the one asked for."""
    IMPAIRED = 32
    """Tactels are not plausible: their readings count as missing."""


LEVEL_SHIFT = 6
"""Bits 6 and 7 of "Cycle flags" are the number of the level and 1: those who listen have it in each summary.
0 is a master that does not say."""


def with_level(flags: int, level: str) -> int:
    """Return "Cycle flags" of a cycle of a level."""
    return int(flags) | (LEVELS.index(level) + 1) << LEVEL_SHIFT


def split_flags(value: int) -> tuple[CycleFlags, str | None]:
    """Return the flags and the level in "Cycle flags"; None where it does not say."""
    number = value >> LEVEL_SHIFT
    return CycleFlags(value & (1 << LEVEL_SHIFT) - 1), LEVELS[number - 1] if number else None


class LevelControl:
    """Keeps the level of a master and counts what was late.

    Args:
        level: the one asked for, the highest ever used.
        available: the highest whose kernels are compiled, until ``limit`` is set; None: all.
        budget_us: most time for the estimator, us; None: what the period leaves.
        is_timed: whether the estimator has a clock; without one no budget is given.
    """

    def __init__(
        self,
        period_ns: int,
        bitrate: int,
        level: str,
        available: str | None = None,
        *,
        budget_us: float | None,
        is_timed: bool,
    ) -> None:
        self.overruns = 0
        """Periods in which no contacts came out in time: cycles that were late, and SYNCs left out."""
        self.cut_short = 0
        """Cycles in which the estimator's time ran out."""
        self._period_ns = period_ns
        self._bit_ns = 1_000_000_000 / bitrate
        self._most_us = budget_us
        self._is_timed = is_timed
        self._top = LEVELS.index(level)
        self.limit = self._rank = LEVELS.index(available or level)
        """The highest that may be used now."""
        self._publishing_ns = 0.0
        self._n_contacts = 0
        self._strained: deque[bool] = deque(maxlen=WINDOW)
        self._n_calm = 0
        self._wait = WAIT_LEAST
        self._n_since_raise = WAIT_MOST
        self._left_out = 0
        self._is_overloaded = False

    @property
    def level(self) -> str:
        """Level of the next cycle."""
        return LEVELS[self._rank]

    def sync(self, gap_ns: int) -> None:
        """Note the time from the SYNC before to this one; what is longer than a period has left some out."""
        self._left_out += max(0, round(gap_ns / self._period_ns) - 1)

    def budget_us(self, since_sync_ns: int) -> float | None:
        """Return the estimator's time when it begins so long after the SYNC, us; None for no limit."""
        if not self._is_timed:
            return None
        # the contacts of the cycle before, and the summary
        wire_ns = (self._n_contacts + 1) * TPDO_BITS * self._bit_ns
        left_ns = self._period_ns - since_sync_ns - wire_ns - self._publishing_ns
        left_us = max(0.0, 1e-3 * left_ns)
        return left_us if self._most_us is None else min(left_us, self._most_us)

    def close(
        self,
        *,
        since_sync_ns: int,
        estimate_ns: int,
        publishing_ns: int,
        budget_us: float | None,
        is_cut_short: bool,
        n_contacts: int,
    ) -> tuple[CycleFlags, str]:
        """Judge a cycle that has ended; return its flags, and what is said when the level changes.

        since_sync_ns: from the SYNC until its contacts were handed to the bus.
        estimate_ns:   of that, the estimator; publishing_ns: of that, all computing after the estimator.
        """
        flags = CycleFlags.LOWERED if self._rank < self._top else CycleFlags(0)
        is_late = since_sync_ns > self._period_ns
        if is_late or self._left_out:
            flags |= CycleFlags.OVERRUN
            self.overruns += is_late + self._left_out
            self._left_out = 0
        if is_cut_short:
            flags |= CycleFlags.CUT_SHORT
            self.cut_short += 1
        self._publishing_ns = max(publishing_ns, (1.0 - FORGET) * self._publishing_ns)
        self._n_contacts = n_contacts
        is_calm = budget_us is None or 1e-3 * estimate_ns <= CALM * budget_us
        return flags, self._adapt(is_strained=is_cut_short or is_late, is_calm=is_calm)

    def _adapt(self, *, is_strained: bool, is_calm: bool) -> str:
        """Note a cycle and choose the level of the next; return what there is to say."""
        self._strained.append(is_strained)
        self._n_since_raise += 1
        self._n_calm = self._n_calm + 1 if is_calm and not is_strained else 0
        if sum(self._strained) >= LOWER and (self._rank > 0 or not self._is_overloaded):
            short = f"time ran out in {LOWER} of {WINDOW} cycles; {REMEDY}"
            if self._rank == 0:
                self._is_overloaded = True
                return f"too slow for {self.level}: {short}"
            if self._n_since_raise <= self._wait:  # too early
                self._wait = min(2 * self._wait, WAIT_MOST)
            self._n_since_raise = WAIT_MOST  # no raise is on trial
            self._go_to(self._rank - 1)
            return f"lowered to {self.level}: {short}"
        if self._n_calm >= WAIT_LEAST:
            self._is_overloaded = False
        if self._n_since_raise == self._wait and self._wait > WAIT_LEAST:  # it has lasted
            self._wait //= 2
        if self._n_calm >= self._wait and self._rank < self.limit:
            self._go_to(self._rank + 1)
            self._n_since_raise = 0
            return f"raised to {self.level}: at most half the time was needed in {self._wait} cycles"
        return ""

    def _go_to(self, rank: int) -> None:
        self._rank = rank
        self._strained.clear()
        self._n_calm = 0
