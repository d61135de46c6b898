"""Detection of another master on a bus: SYNC that is not ours."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from skinbus.can.core import receives
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.errors import BusError
from skinbus.objects import cia

GONE_NS: Final = 2_000_000_000
"""Without a SYNC of others for so long, there is no other master: long against any useful period."""

"""Kinds of events: it came, it is gone."""

_SYNC: Final = frozenset({cia.SYNC_ID})


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
            return [Event(t_ns=now_ns, kind=EventKind.OTHER_MASTER, detail=detail)] if is_new else []
        if self.is_present and now_ns - self.last_ns > GONE_NS:
            self.is_present = False
            return [Event(t_ns=now_ns, kind=EventKind.OTHER_MASTER_END)]
        return []
