"""Error frames as Linux writes them become events: a fault once when it begins and once when it ends."""

from __future__ import annotations

from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frames

# Error classes, and bits of the controller's byte data[1] (linux/can/error.h).
ERR_TX_TIMEOUT = 0x001
ERR_CRTL = 0x004
ERR_BUSOFF = 0x040
ERR_RESTARTED = 0x100
ERR_OF_INTEREST = ERR_TX_TIMEOUT | ERR_CRTL | ERR_BUSOFF | ERR_RESTARTED
CRTL_OVERFLOW = 0x03
CRTL_WARNING = 0x0C
CRTL_PASSIVE = 0x30
CRTL_ACTIVE = 0x40


class FaultWatch:
    """Keeps the faults that are present: each is reported once when it appears and once when it clears."""

    def __init__(self) -> None:
        self.n_dropped = 0
        """Frames lost in reception that have been reported."""
        self.pending: list[tuple[EventKind, str]] = []
        """What has been detected and not been reported yet."""
        self._present: set[EventKind] = set()

    def take(self, frames: Frames) -> None:
        """Take error frames (linux/can/error.h)."""
        for frame in frames:
            data = frame.data.ljust(8, b"\0")
            if frame.can_id & ERR_CRTL:
                self._controller(data)
            if frame.can_id & ERR_BUSOFF:
                self._comes(EventKind.BUS_OFF)
            if frame.can_id & ERR_RESTARTED:
                self._goes(EventKind.BUS_OFF, EventKind.ERROR_PASSIVE, EventKind.ERROR_WARNING)
            if frame.can_id & ERR_TX_TIMEOUT:
                self.pending.append((EventKind.SEND_QUEUE_FULL, "the driver gave up sending"))

    def send_queue_full(self, n_lost: int) -> None:
        """Frames could not be sent."""
        self._comes(EventKind.SEND_QUEUE_FULL, f"{n_lost} frames lost; is any other node on the bus?")

    def send_queue_free(self) -> None:
        """Frames were sent."""
        if self._present:
            self._goes(EventKind.SEND_QUEUE_FULL)

    def news(self, now_ns: int, n_dropped: int) -> list[Event]:
        """What has come and gone since the last call; ``n_dropped`` frames were lost so far."""
        events = [Event(now_ns, fault, detail=detail) for fault, detail in self.pending]
        self.pending.clear()
        if n_dropped != self.n_dropped:
            count = n_dropped - self.n_dropped
            events.append(Event(now_ns, EventKind.FRAMES_DROPPED, detail=f"{count} frames", count=count))
            self.n_dropped = n_dropped
        return events

    def _controller(self, data: bytes) -> None:
        state = data[1]
        if state & CRTL_OVERFLOW:
            self.pending.append((EventKind.CONTROLLER_OVERFLOW, "the controller lost frames"))
        counters = f"errors: {data[6]} sending, {data[7]} receiving" if data[6] or data[7] else ""
        if state & CRTL_PASSIVE:
            self._comes(EventKind.ERROR_PASSIVE, counters)
        elif state & CRTL_WARNING:
            self._goes(EventKind.BUS_OFF, EventKind.ERROR_PASSIVE)
            self._comes(EventKind.ERROR_WARNING, counters)
        elif state & CRTL_ACTIVE:
            self._goes(EventKind.BUS_OFF, EventKind.ERROR_PASSIVE, EventKind.ERROR_WARNING)

    def _comes(self, fault: EventKind, detail: str = "") -> None:
        if fault not in self._present:
            self._present.add(fault)
            self.pending.append((fault, detail))

    def _goes(self, *faults: EventKind) -> None:
        gone = self._present.intersection(faults)
        if gone:
            self._present -= gone
            self.pending += [(fault.end, "") for fault in sorted(gone)]
