"""TIME: the master sends the time of day every so often, if the arm file asks for it (CiA 301, 7.2.6)."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.node.device import Device
from skinbus.objects import cia

TIME_OF_DAY: Final = struct.Struct("<IH")
"""Milliseconds since midnight, and days since 1 January 1984."""
EPOCH_DAYS: Final = 5113
"""Days from 1 January 1970 to 1 January 1984."""
DAY_MS: Final = 86_400_000
MAX_DAYS: Final = 0xFFFF


class TimeProducer:
    """Produces TIME on one bus; 0x1012 of the device says whether, 0x1013 has the microseconds of the last.

    ``period_s``  seconds between two TIME messages, 0 for none
    ``unix_ns``   returns the time of day, ns since 1970 (UTC); without it there is no TIME
    """

    def __init__(self, device: Device, period_s: float, unix_ns: Callable[[], int] | None) -> None:
        self._device = device
        self._period_ns = round(1e9 * period_s)
        self._unix_ns = unix_ns if period_s else None
        self.wake_ns = NEVER
        """Time of the next message, ns."""

    def boot(self, now_ns: int) -> None:
        """Begin: the first message follows with the next step."""
        produces = cia.COB_ID_PRODUCER if self._unix_ns else 0
        self._device.set(cia.TIME_COB_ID, 0, cia.TIME_ID | produces)
        self.wake_ns = now_ns if self._unix_ns else NEVER

    def step(self, now_ns: int) -> list[Frame]:
        """Return the message that is due, if any; missed ones are left out."""
        if now_ns < self.wake_ns or self._unix_ns is None:
            return []
        self.wake_ns = now_ns + self._period_ns
        unix_ns = self._unix_ns()
        self._device.set(cia.HIGH_RESOLUTION_TIME, 0, unix_ns // 1000 & 0xFFFFFFFF)
        days, ms = divmod(unix_ns // 1_000_000, DAY_MS)
        return [Frame(cia.TIME_ID, TIME_OF_DAY.pack(ms, min(max(days - EPOCH_DAYS, 0), MAX_DAYS)))]
