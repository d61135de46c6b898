"""Other masters on the bus: all report them, and of those that are started together one runs."""

from __future__ import annotations

import struct
from collections.abc import Iterable

from skinbus.can.core import NEVER, receives
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame, Frames
from skinbus.errors import BusError
from skinbus.objects import cia

GONE_NS = 2_000_000_000
"""Without a SYNC of others for so long, there is no other master: long against any useful period."""

_SYNC = frozenset({cia.SYNC_ID})


class OtherMaster:
    """Detects another master while it is there.

    A master at work reports it and goes on: two masters that both gave way would leave the arm without any.
    One that is about to begin, and a tool that configures, gives way.
    """

    cob_ids = _SYNC

    def __init__(self) -> None:
        self.last_ns = 0
        """Time of its newest SYNC."""
        self.is_present = False
        """Whether there is another master."""

    def refuse(self, where: str) -> None:
        """Raise BusError while there is one: two masters would reset each other's patches."""
        if self.is_present:
            raise BusError(f"a master is at work on {where} (it sends SYNC); stop it first")

    def step(self, now_ns: int, frames: Iterable[Frame]) -> list[Event]:
        """Take the frames of the bus, among which are none of ours; return what is new."""
        if any(receives(_SYNC, frame) for frame in frames):
            is_new, self.is_present, self.last_ns = not self.is_present, True, now_ns
            detail = "SYNC of another master; stop one of the two"
            return [Event(now_ns, EventKind.OTHER_MASTER, detail=detail, cob_id=cia.SYNC_ID)] * is_new
        if self.is_present and now_ns - self.last_ns > GONE_NS:
            self.is_present = False
            return [Event(now_ns, EventKind.OTHER_MASTER_END, cob_id=cia.SYNC_ID)]
        return []


CONTEST_NS = 100_000_000
"""A claim is made so long before the first SYNC; its time in there depends on the number of the master."""

SPREAD_US = 0x10000
REPEAT_NS = 1_000_000_000
"""Between two claims because of SYNCs of another: it may be a device that makes no claims."""

CLAIM = struct.Struct("<BBI")
"""Data of 0x071: priority, node-ID, number. The lowest wins."""

RUNS, BEGINS = 0, 1
"""Priorities."""


class Contest:
    """Decides which of several masters runs, like the flying master of CiA 302-2.

    A master claims the bus before it sends anything else. One that receives a better claim sends nothing
    more; one that receives a worse claim repeats its own. Claims only get better, when a master begins to
    run; so two never give way to each other.
    """

    cob_ids = frozenset({cia.ACTIVE_MASTER_ID, cia.SYNC_ID})

    def __init__(self, node_id: int, number: int, n_buses: int) -> None:
        """``number``: of 32 bits, another for each master."""
        self._node_id, self._number, self._n_buses = node_id, number, n_buses
        self._claim_ns = NEVER
        self._begin_ns = 0
        self.error: BusError | None = None
        """Why it has given way to another master."""
        self.has_begun = False
        """Whether the bus was free: the master runs."""

    @property
    def wake_ns(self) -> int:
        """Time of the next thing to do before it runs (ns)."""
        return min(self._claim_ns, self._begin_ns)

    def step(self, now_ns: int, frames: Frames) -> list[Frame]:
        """Take the frames of the buses, among which are none of ours; return those to send."""
        if not self._begin_ns:
            self._begin_ns = now_ns + CONTEST_NS
            self._claim_ns = now_ns + 1000 * (self._number % SPREAD_US)
        self.has_begun |= now_ns >= self._begin_ns
        own = CLAIM.pack(RUNS if self.has_begun else BEGINS, self._node_id, self._number)
        must_claim = now_ns >= self._claim_ns and not self.has_begun
        for frame in frames:
            if frame.can_id == cia.ACTIVE_MASTER_ID and len(frame.data) == CLAIM.size:
                must_claim |= frame.data != own
                if CLAIM.unpack(frame.data) < CLAIM.unpack(own):
                    self.error = BusError(f"gave way to another master (node-ID {frame.data[1]})")
            elif receives(_SYNC, frame) and not self.has_begun:
                self.error = BusError("gave way to another master (it sends SYNC)")
            elif receives(_SYNC, frame) and now_ns >= self._claim_ns:
                must_claim = True
        if self.error or not must_claim:
            return []
        self._claim_ns = now_ns + REPEAT_NS
        return [Frame(cia.ACTIVE_MASTER_ID, own, bus=k) for k in range(self._n_buses)]
