"""A line: one interface of a core, kept open; what is lost is opened again and again with growing pauses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final, Protocol, runtime_checkable

from skinbus.can.clock import Clock
from skinbus.can.core import BusFault, BusWatcher, Core, DataCore, Event, SendWatcher, cob_ids_of, listens
from skinbus.can.frame import Frame, FrameBatch
from skinbus.errors import BusError

FIRST_PAUSE_NS: Final = 50_000_000
LONGEST_PAUSE_NS: Final = 250_000_000
"""Pauses between attempts to open a lost bus; contacts are back within a second of its being there."""


class Bus(Protocol):
    """What the loop needs of an interface."""

    def receive(self, timeout_s: float) -> Sequence[Frame]:
        """All frames that are there, waiting at most ``timeout_s`` for the first."""

    def send(self, frames: Sequence[Frame]) -> int:
        """Send them in this order; how many went out."""

    def close(self) -> None:
        """Let go of the interface; BusError when that fails."""


@runtime_checkable
class DescribedBus(Bus, Protocol):
    """An interface that can be waited for together with others."""

    def descriptors(self, *, for_data: bool = True) -> Sequence[int]:
        """File descriptors that become readable when frames are there; none if it has no such thing."""


@runtime_checkable
class DataBus(DescribedBus, Protocol):
    """An interface that sorts frames in the kernel and reads those of the data plane in batches."""

    @property
    def batch(self) -> FrameBatch:
        """Data-plane frames of the last ``receive``."""

    def listen(self, cob_ids: frozenset[int] | None, data_ids: frozenset[int] = frozenset()) -> None:
        """Receive these identifiers only (None: all), of them ``data_ids`` into the batch."""

    def news(self) -> Sequence[Event]:
        """Faults of the bus since the last call."""

    # Its ``send`` gives up all that follows the first frame it cannot send: what went out is a beginning.


class ManagedInterface:
    """One interface of a core: number ``number`` of its buses."""

    def __init__(
        self,
        number: int,
        core: Core,
        open_bus: Callable[[], Bus],
        clock: Clock,
        tell: Callable[[Event], None],
    ) -> None:
        """``tell`` gets the events of the line, BusFault.LOST and BACK among them."""
        self.number = number
        self.bus: Bus | None = None
        self.data_bus: DataBus | None = None
        self.retry_ns = 0
        self.n_received = 0
        self.n_sent = 0
        self.n_lost = 0
        self.n_outages = 0
        self._cob_ids = cob_ids_of(core, number)
        self._open_bus = open_bus
        self._clock = clock
        self._tell = tell
        self._data_core = core if isinstance(core, DataCore) else None
        self._watched = isinstance(core, BusWatcher)
        self._send_watcher = core if isinstance(core, SendWatcher) else None
        self._heard_ids: frozenset[int] | None = frozenset()
        self._pause_ns = FIRST_PAUSE_NS

    def open(self) -> None:
        """Open the interface, and have its kernel sort frames if it can; BusError if that fails."""
        bus = self._open_bus()
        data_bus = bus if isinstance(bus, DataBus) else None
        if data_bus:
            try:
                self._listen(data_bus)
            except BusError:
                with suppress(BusError):
                    bus.close()
                raise
        self.bus, self.data_bus = bus, data_bus

    def follow(self) -> None:
        """Listen to what the core listens to now."""
        if self.data_bus and self._cob_ids() is not self._heard_ids:
            try:
                self._listen(self.data_bus)
            except BusError as error:
                self._lose(error)

    def descriptors(self, *, for_data: bool) -> Sequence[int]:
        """File descriptors to wait for; none if there are none."""
        return self.bus.descriptors(for_data=for_data) if isinstance(self.bus, DescribedBus) else ()

    def receive(self, timeout_ns: int) -> Sequence[Frame] | None:
        """What the core listens to of what is there, None if nothing came for it; it is given data frames."""
        if self.bus is None:
            return None
        try:
            frames = self.bus.receive(timeout_ns * 1e-9)
        except BusError as error:
            self._lose(error)
            return self._after_news()
        came = self._take_data(self.data_bus) if self.data_bus else False
        if not frames:
            return () if came else None
        self.n_received += len(frames)
        cob_ids = self._cob_ids()
        if cob_ids is not None:
            frames = [frame for frame in frames if listens(cob_ids, frame)]
        return [frame._replace(bus=self.number) for frame in frames] if self.number else frames

    def send(self, frames: Sequence[Frame]) -> None:
        """Send what the core wants to; count what did not go out, and tell the core."""
        n_sent = 0
        if self.bus is not None:
            try:
                n_sent = self.bus.send(frames)
            except BusError as error:
                self._lose(error)
        self.n_sent += n_sent
        self.n_lost += len(frames) - n_sent
        if self._send_watcher and n_sent < len(frames):
            # SocketCAN gives up all from one frame on; of python-can's any may be meant: twice is not lost.
            unsure = frames[n_sent:] if self.data_bus else frames
            self._send_watcher.not_sent(self._clock.now_ns(), unsure)

    def reopen(self) -> Sequence[Frame] | None:
        """Try to open a lost interface if it is time; what ``receive`` would return."""
        if self._clock.now_ns() < self.retry_ns:
            return None
        try:
            self.open()
        except BusError:
            self._pause_ns = min(2 * self._pause_ns, LONGEST_PAUSE_NS)
            self.retry_ns = self._clock.now_ns() + self._pause_ns
            return None
        self._say(Event(t_ns=self._clock.now_ns(), kind=BusFault.BACK))
        return self._after_news()

    def close(self) -> None:
        """Let go of the interface, whatever state it is in."""
        bus, self.bus, self.data_bus = self.bus, None, None
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
        self._say(Event(t_ns=self._clock.now_ns(), kind=BusFault.LOST, detail=detail))

    def _take_data(self, bus: DataBus) -> bool:
        """Pass data frames and faults on; whether there were any."""
        batch = bus.batch
        if batch.n and self._data_core:
            self.n_received += batch.n
            if self.number:
                batch.frames["bus"][: batch.n] = self.number
            self._data_core.take(self._clock.now_ns(), batch)
        news = bus.news()
        for event in news:
            self._say(event)
        return batch.n > 0 or bool(news)

    def _listen(self, bus: DataBus) -> None:
        """Tell the bus what the core listens to."""
        self._heard_ids = self._cob_ids()
        data_ids = self._data_core.data_ids_on(self.number) if self._data_core else frozenset()
        bus.listen(self._heard_ids, data_ids)

    def _after_news(self) -> Sequence[Frame] | None:
        """What ``receive`` returns when the bus went or came: a core that watches it steps at once."""
        return () if self._watched else None

    def _say(self, event: Event) -> None:
        self._tell(replace(event, bus=self.number) if self.number else event)
