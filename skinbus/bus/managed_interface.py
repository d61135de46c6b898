"""One interface of a core, kept open; when it is lost it is opened again and again with growing pauses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

from skinbus.bus.interface import Bus
from skinbus.can.clock import Clock
from skinbus.can.core import Core, receives
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import CobIds, Frames
from skinbus.errors import BusError

FIRST_PAUSE_NS = 50_000_000
LONGEST_PAUSE_NS = 250_000_000
"""Pauses between attempts to open a lost bus; contacts are back within a second of its being there."""


class ManagedInterface:
    """One interface of a core: number ``number`` of its buses."""

    def __init__(
        self,
        number: int,
        core: Core,
        open_bus: Callable[[], Bus],
        clock: Clock,
        report: Callable[[Event], None],
    ) -> None:
        """``report`` gets the events of the interface, BUS_LOST and BUS_BACK among them."""
        self.number = number
        self.bus: Bus | None = None
        self.retry_ns = 0
        self.n_received = 0
        self.n_sent = 0
        self.n_lost = 0
        self.n_outages = 0
        self._core = core
        self._open_bus = open_bus
        self._clock = clock
        self._report = report
        self._heard_ids: CobIds | None = frozenset()
        self._pause_ns = FIRST_PAUSE_NS

    def open(self) -> None:
        """Open the interface and have it sort frames; BusError if that fails."""
        bus = self._open_bus()
        try:
            self._listen(bus)
        except BusError:
            with suppress(BusError):
                bus.close()
            raise
        self.bus = bus

    def follow(self) -> None:
        """Listen to what the core listens to now."""
        if self.bus is not None and self._core.cob_ids_on(self.number) is not self._heard_ids:
            try:
                self._listen(self.bus)
            except BusError as error:
                self._lose(error)

    def descriptors(self, *, for_data: bool) -> Sequence[int]:
        """File descriptors to wait for; none if there are none."""
        return self.bus.descriptors(for_data=for_data) if self.bus is not None else ()

    def receive(self, timeout_ns: int) -> Frames | None:
        """What the core listens to of what is there, None if nothing came for it; it is given data frames."""
        if self.bus is None:
            return None
        try:
            frames = self.bus.receive(timeout_ns * 1e-9)
        except BusError as error:
            self._lose(error)
            return ()
        came = self._take_data(self.bus)
        if not frames:
            return () if came else None
        self.n_received += len(frames)
        if self._heard_ids is not None:
            frames = [frame for frame in frames if receives(self._heard_ids, frame)]
        return [frame._replace(bus=self.number) for frame in frames] if self.number else frames

    def send(self, frames: Frames) -> None:
        """Send the frames of the core; count those not sent, and report them to the core."""
        n_sent = 0
        if self.bus is not None:
            try:
                n_sent = self.bus.send(frames)
            except BusError as error:
                self._lose(error)
        self.n_sent += n_sent
        self.n_lost += len(frames) - n_sent
        if n_sent < len(frames):
            # Where any of them may be the lost one, all are repeated: twice is not lost.
            in_order = self.bus is not None and self.bus.gives_up_in_order
            self._core.not_sent(self._clock.now_ns(), frames[n_sent:] if in_order else frames)

    def reopen(self) -> Frames | None:
        """Try to open a lost interface if it is time; what ``receive`` would return."""
        if self._clock.now_ns() < self.retry_ns:
            return None
        try:
            self.open()
        except BusError:
            self._pause_ns = min(2 * self._pause_ns, LONGEST_PAUSE_NS)
            self.retry_ns = self._clock.now_ns() + self._pause_ns
            return None
        self._say(Event(self._clock.now_ns(), EventKind.BUS_BACK))
        return ()

    def close(self) -> None:
        """Let go of the interface, whatever state it is in."""
        bus, self.bus = self.bus, None
        if bus is not None:
            bus.close()

    def _lose(self, error: BusError) -> None:
        """The bus is gone: let go of it, say so, and try again soon."""
        detail = str(error)
        try:
            self.close()
        except BusError as more:  # it is let go of all the same
            detail += f"; {more}"
        self.n_outages += 1
        self._pause_ns = FIRST_PAUSE_NS
        self.retry_ns = self._clock.now_ns() + self._pause_ns
        self._say(Event(self._clock.now_ns(), EventKind.BUS_LOST, detail=detail))

    def _take_data(self, bus: Bus) -> bool:
        """Pass data frames and faults on; return whether there were any."""
        batch = bus.batch
        if batch.n:
            self.n_received += batch.n
            if self.number:
                batch.frames["bus"][: batch.n] = self.number
            self._core.take(self._clock.now_ns(), batch)
        news = bus.news()
        for event in news:
            self._say(event)
        return batch.n > 0 or bool(news)

    def _listen(self, bus: Bus) -> None:
        """Have the interface receive what the core receives."""
        self._heard_ids = self._core.cob_ids_on(self.number)
        bus.listen(self._heard_ids, self._core.data_ids_on(self.number))

    def _say(self, event: Event) -> None:
        self._report(replace(event, bus=self.number) if self.number else event)
