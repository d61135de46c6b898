"""What a CAN controller and the kernel tell of the bus: error frames and drop counters become events."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from skinbus.bus import socketcan_abi as abi
from skinbus.bus.core import BusFault, Event
from skinbus.bus.frame import Frame

LOOK_EVERY_NS: Final = 5_000_000
"""Time between looks at the interface's counter, 5 us each: a loss is told in its own cycle."""


class Statistic:
    """A counter of an interface (/sys/class/net/NAME/statistics/...), read as often as one likes."""

    def __init__(self, file: Path) -> None:
        try:
            self._fd = os.open(file, os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            self._fd = -1

    def read(self) -> int | None:
        """The counter; None if it cannot be read or the interface is gone."""
        try:
            return int(os.pread(self._fd, 32, 0)) if self._fd >= 0 else None
        except (OSError, ValueError):
            return None

    def close(self) -> None:
        """Let go of the file; a second call does nothing."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


class BacklogDrops:
    """Counts received frames that were lost before they came to any socket, since it was made.

    A kernel that is too busy to hand frames on queues a thousand of them (net.core.netdev_max_backlog) and
    drops the rest; so does a driver without memory. No socket hears of these: they are the interface's
    ``rx_dropped``. Where that cannot be read, nothing is counted.
    """

    def __init__(self, statistic: Statistic) -> None:
        self.n = 0
        self._next_ns = 0
        self._statistic = statistic
        self._before = statistic.read() or 0

    def look(self) -> None:
        """Bring ``n`` up to date."""
        value = self._statistic.read()
        if value is not None:
            self.n = max(value - self._before, self.n)

    def look_at_times(self, now_ns: int) -> None:
        """Do so if the last look was some time ago."""
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + LOOK_EVERY_NS
            self.look()

    def close(self) -> None:
        """Let go of the counter; ``n`` stays."""
        self._statistic.close()


class FaultWatch:
    """Remembers which faults are present, so that each is told once when it comes and once when it goes."""

    def __init__(self) -> None:
        self.n_dropped = 0
        """Frames lost in reception that have been told of."""
        self.pending: list[tuple[BusFault, str]] = []
        """What has been noticed and not been told yet."""
        self._present: set[BusFault] = set()

    def take(self, frames: Sequence[Frame]) -> None:
        """Take error frames (linux/can/error.h)."""
        for frame in frames:
            data = frame.data.ljust(8, b"\0")
            if frame.can_id & abi.ERR_CRTL:
                self._controller(data)
            if frame.can_id & abi.ERR_BUSOFF:
                self._comes(BusFault.BUS_OFF)
            if frame.can_id & abi.ERR_RESTARTED:
                self._goes(BusFault.BUS_OFF, BusFault.PASSIVE, BusFault.WARNING)
            if frame.can_id & abi.ERR_TX_TIMEOUT:
                self.pending.append((BusFault.SEND_QUEUE_FULL, "the driver gave up sending"))

    def send_queue_full(self, n_lost: int) -> None:
        """Frames could not be sent."""
        self._comes(BusFault.SEND_QUEUE_FULL, f"{n_lost} frames lost; is any other node on the bus?")

    def send_queue_free(self) -> None:
        """Frames were sent."""
        if self._present:
            self._goes(BusFault.SEND_QUEUE_FULL)

    def news(self, now_ns: int, n_dropped: int) -> list[Event]:
        """What has come and gone since the last call; ``n_dropped`` frames were lost so far."""
        events = [Event(t_ns=now_ns, kind=fault, detail=detail) for fault, detail in self.pending]
        self.pending.clear()
        if n_dropped != self.n_dropped:
            count = n_dropped - self.n_dropped
            events.append(Event(t_ns=now_ns, kind=BusFault.OVERFLOW, detail=f"{count} frames", count=count))
            self.n_dropped = n_dropped
        return events

    def _controller(self, data: bytes) -> None:
        state = data[1]
        if state & abi.CRTL_OVERFLOW:
            self.pending.append((BusFault.CONTROLLER_OVERFLOW, "the controller lost frames"))
        counters = f"errors: {data[6]} sending, {data[7]} receiving" if data[6] or data[7] else ""
        if state & abi.CRTL_PASSIVE:
            self._comes(BusFault.PASSIVE, counters)
        elif state & abi.CRTL_WARNING:
            self._goes(BusFault.BUS_OFF, BusFault.PASSIVE)
            self._comes(BusFault.WARNING, counters)
        elif state & abi.CRTL_ACTIVE:
            self._goes(BusFault.BUS_OFF, BusFault.PASSIVE, BusFault.WARNING)

    def _comes(self, fault: BusFault, detail: str = "") -> None:
        if fault not in self._present:
            self._present.add(fault)
            self.pending.append((fault, detail))

    def _goes(self, *faults: BusFault) -> None:
        gone = self._present.intersection(faults)
        if gone:
            self._present -= gone
            self.pending += [(fault.end, "") for fault in sorted(gone)]
