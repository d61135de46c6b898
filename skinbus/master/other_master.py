"""OtherMaster: another master on the bus, known by SYNCs that are not ours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from skinbus.can.core import Event
from skinbus.can.frame import Frame
from skinbus.node.device import Device
from skinbus.objects import cia

GONE_NS: Final = 2_000_000_000
"""Without a SYNC of others for so long, there is no other master: long against any useful period."""

OTHER_MASTER: Final = "other-master"
OTHER_MASTER_END: Final = "other-master-end"
"""Kinds of events: it came, it is gone."""

_DATA: Final = cia.SYNC_ID.to_bytes(4, "little")


class OtherMaster:
    """Tells of another master while it is there: by an event, and by EMCY 0x8100 with the COB-ID of SYNC.

    Nothing is done about it: two masters that both gave way would leave the arm without any.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
        self._heard_ns: int | None = None

    def hear(self, now_ns: int, frames: Sequence[Frame]) -> list[Event]:
        """Take the frames of the bus, among which are none of ours; return what is new."""
        if any(frame.can_id == cia.SYNC_ID for frame in frames):
            is_new, self._heard_ns = self._heard_ns is None, now_ns
            self._device.emcy(cia.EmcyCode.COMMUNICATION, data=_DATA)  # anew if the node was reset
            if is_new:
                detail = "somebody else sends SYNC too; stop one of the two"
                return [Event(t_ns=now_ns, kind=OTHER_MASTER, detail=detail)]
        elif self._heard_ns is not None and now_ns - self._heard_ns > GONE_NS:
            self._heard_ns = None
            self._device.emcy_clear(cia.EmcyCode.COMMUNICATION, data=_DATA)
            return [Event(t_ns=now_ns, kind=OTHER_MASTER_END)]
        return []
