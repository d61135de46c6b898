"""The one loop that owns a core on a real interface: waits, steps, sends, and outlives the bus.

A core's wake-up is met to a few microseconds where the machine lets it (SYNC jitter is contact jitter):
the thread sleeps until shortly before and polls the rest of the way. When the bus is lost the core goes
on being woken at its times, hears nothing, and what it sends is gone; the bus is opened again and again
with growing pauses.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol, runtime_checkable

from skinbus.bus.clock import Clock, MonotonicClock, sharpen_timers
from skinbus.bus.core import STOP, BusFault, BusWatcher, Core, DataCore, Event, SendWatcher, Step, listens
from skinbus.bus.frame import Frame, FrameBatch
from skinbus.bus.hotloop import Tidy
from skinbus.errors import BusError

BUS_LOST: Final = BusFault.LOST
BUS_BACK: Final = BusFault.BACK
"""Kinds of events that the loop itself adds."""

IDLE_NS: Final = 100_000_000
"""Longest sleep, after which ``stop`` is looked at."""

POLL_NS: Final = 150_000
"""Polling begins this long before a wake-up: what a sleep overshoots (median 60, p99 200 us when idle)."""

FIRST_PAUSE_NS: Final = 50_000_000
LONGEST_PAUSE_NS: Final = 250_000_000
"""Pauses between attempts to open a lost bus; contacts are back within a second of its being there."""

PACED_FROM: Final = 8
"""Data frames owed beyond which the loop sleeps through some of them: waking costs more than reading."""

SHORTEST_PACE_NS: Final = 100_000
LONGEST_PACE_NS: Final = 1_000_000
"""Such a sleep: long enough to be worth it, short enough to be no latency."""


class Bus(Protocol):
    """What the loop needs of an interface."""

    def receive(self, timeout_s: float) -> Sequence[Frame]:
        """All frames that are there, waiting at most ``timeout_s`` for the first."""

    def send(self, frames: Sequence[Frame]) -> int:
        """Send them in this order; how many went out."""

    def close(self) -> None:
        """Let go of the interface."""


@runtime_checkable
class DataBus(Bus, Protocol):
    """An interface that sorts frames in the kernel and reads those of the data plane in batches."""

    @property
    def batch(self) -> FrameBatch:
        """Data-plane frames of the last ``receive``."""

    def listen(self, cob_ids: frozenset[int] | None, data_ids: frozenset[int] = frozenset()) -> None:
        """Receive these identifiers only (None: all), of them ``data_ids`` into the batch."""

    def wait(self, timeout_s: float, *, for_data: bool = True) -> None:
        """Return when frames are there, of the data plane only if wanted, or after ``timeout_s``."""

    def news(self) -> Sequence[Event]:
        """Faults of the bus since the last call."""

    # Its ``send`` gives up all that follows the first frame it cannot send: what went out is a beginning.


@dataclass(slots=True)
class DriveReport:
    """What the loop did until it ended."""

    steps: int = 0
    n_received: int = 0
    n_sent: int = 0
    n_lost: int = 0
    """Frames of the core that did not go out."""
    n_outages: int = 0
    late_ns: list[int] = field(default_factory=list)
    """How late each wake-up was; the newest ``keep_late`` of them."""


def drive(
    core: Core,
    open_bus: Callable[[], Bus],
    *,
    stop: threading.Event,
    clock: Clock | None = None,
    on_step: Callable[[Step], object] | None = None,
    on_event: Callable[[Event], object] | None = None,
    farewell: Callable[[int], Sequence[Frame]] | None = None,
    keep_late: int = 0,
    tidy: Tidy | None = None,
) -> DriveReport:
    """Run ``core`` on the bus that ``open_bus`` opens until ``stop`` is set or the core sends a STOP event.

    The first opening must succeed (else BusError); a bus lost later is opened again for as long as it takes.
    on_step   called after each step, in this thread: short, please
    on_event  called with each event of the core, and with BUS_LOST and BUS_BACK
    tidy      collects garbage, while the loop would sleep
    farewell  called with the time when all is over, however it came: frames to send before the bus is closed
    """
    return _Driver(
        core, open_bus, stop, clock or MonotonicClock(), on_step, on_event, farewell, keep_late, tidy
    ).run()


class _Driver:
    def __init__(
        self,
        core: Core,
        open_bus: Callable[[], Bus],
        stop: threading.Event,
        clock: Clock,
        on_step: Callable[[Step], object] | None,
        on_event: Callable[[Event], object] | None,
        farewell: Callable[[int], Sequence[Frame]] | None,
        keep_late: int,
        tidy: Tidy | None,
    ) -> None:
        self.core = core
        self.open_bus = open_bus
        self.stop = stop
        self.clock = clock
        self.on_step = on_step
        self.on_event = on_event
        self.farewell = farewell
        self.keep_late = keep_late
        self.tidy = tidy
        self.report = DriveReport()
        self.bus: Bus | None = None
        self.retry_ns = 0
        self.pause_ns = FIRST_PAUSE_NS
        self.stopping = False
        self.data_core = core if isinstance(core, DataCore) else None
        self.watcher = core if isinstance(core, BusWatcher) else None
        self.send_watcher = core if isinstance(core, SendWatcher) else None
        self.data_bus: DataBus | None = None
        self.heard_ids: frozenset[int] | None = frozenset()
        self.pace_ns = 0
        self.last_data_ns = 0

    def run(self) -> DriveReport:
        """The loop."""
        self.attach(self.open_bus())
        sharpen_timers()
        try:
            frames: Sequence[Frame] = ()
            while not self.stopping:
                wake_ns = self.step(frames)
                if not self.stopping:
                    frames = self.wait(wake_ns)
        finally:
            if self.farewell:
                self.send(self.farewell(self.clock.now_ns()))
            self.close()
        return self.report

    def step(self, frames: Sequence[Frame]) -> int:
        """One step of the core, with all that follows from it; the time of its next one."""
        step = self.core.step(self.clock.now_ns(), frames)
        self.report.steps += 1
        if self.data_bus and self.core.cob_ids is not self.heard_ids:
            try:
                self.listen(self.data_bus)
            except BusError as error:
                self.lose(error)
        if step.frames:
            self.send(step.frames)
        for event in step.events:
            self.tell(event)
        if self.on_step:
            self.on_step(step)
        return step.wake_ns

    def wait(self, wake_ns: int) -> Sequence[Frame]:
        """Frames for the core, or nothing when it is ``wake_ns``; returns early when asked to stop."""
        while not self.stop.is_set():
            now_ns = self.clock.now_ns()
            left_ns = wake_ns - now_ns
            due = left_ns <= 0
            if due or left_ns <= POLL_NS:
                timeout_ns = 0
            else:
                timeout_ns = min(left_ns - POLL_NS, IDLE_NS)
                if self.tidy and not (self.data_core and self.data_core.n_owed):
                    self.tidy.pause(timeout_ns)
                    timeout_ns = max(wake_ns - self.clock.now_ns() - POLL_NS, 0)
                    timeout_ns = min(timeout_ns, IDLE_NS)
            frames = self.receive(timeout_ns)
            if due:
                self.note_lateness(now_ns - wake_ns)
            if frames is not None or due:
                return frames or ()
        self.stopping = True
        return ()

    def receive(self, timeout_ns: int) -> Sequence[Frame] | None:
        """What the core listens to of what is there, None if nothing came for it.

        With the bus lost, the time is spent on opening it.
        """
        if self.bus is None:
            return self.after_news() if self.reopen(timeout_ns) else None
        try:
            if self.data_bus and self.pace_ns and timeout_ns:
                self.data_bus.wait(min(self.pace_ns, timeout_ns) * 1e-9, for_data=False)
                timeout_ns = 0
            frames = self.bus.receive(timeout_ns * 1e-9)
        except BusError as error:
            self.lose(error)
            return self.after_news()
        came = self.take_data(self.data_bus) if self.data_bus else False
        if not frames:
            return () if came else None
        self.report.n_received += len(frames)
        cob_ids = self.core.cob_ids
        return frames if cob_ids is None else [frame for frame in frames if listens(cob_ids, frame)]

    def take_data(self, bus: DataBus) -> bool:
        """Pass data frames and faults on; whether there were any."""
        batch = bus.batch
        n, self.pace_ns = batch.n, 0
        if n and self.data_core:
            self.report.n_received += n
            self.data_core.take(self.clock.now_ns(), batch)
            last_ns = int(batch.t_ns[n - 1])
            owed = self.data_core.n_owed
            if owed > PACED_FROM:
                # At the pace of the last frames: be awake again when half of what is owed has come.
                pace_ns = min(owed * (last_ns - self.last_data_ns) // (2 * n), LONGEST_PACE_NS)
                self.pace_ns = pace_ns if pace_ns >= SHORTEST_PACE_NS else 0
            self.last_data_ns = last_ns
        news = bus.news()
        for event in news:
            self.tell(event)
        return n > 0 or bool(news)

    def after_news(self) -> Sequence[Frame] | None:
        """What ``receive`` returns when the bus went or came: a core that watches it steps at once."""
        return () if self.watcher else None

    def attach(self, bus: Bus) -> None:
        """Take an open bus, and have its kernel sort frames if it can."""
        data_bus = bus if isinstance(bus, DataBus) else None
        if data_bus:
            try:
                self.listen(data_bus)
            except BusError:
                bus.close()
                raise
        self.bus, self.data_bus = bus, data_bus

    def listen(self, bus: DataBus) -> None:
        """Tell the bus what the core listens to."""
        self.heard_ids = self.core.cob_ids
        bus.listen(self.heard_ids, self.data_core.data_ids if self.data_core else frozenset())

    def send(self, frames: Sequence[Frame]) -> None:
        """Send what the core wants to; count what did not go out, and tell the core."""
        n_sent = 0
        if self.bus is not None:
            try:
                n_sent = self.bus.send(frames)
            except BusError as error:
                self.lose(error)
        self.report.n_sent += n_sent
        self.report.n_lost += len(frames) - n_sent
        if self.send_watcher and n_sent < len(frames):
            # SocketCAN gives up all from one frame on; of python-can's any may be meant: twice is not lost.
            unsure = frames[n_sent:] if self.data_bus else frames
            self.send_watcher.not_sent(self.clock.now_ns(), unsure)

    def lose(self, error: BusError) -> None:
        """The bus is gone: let go of it, say so, and try again soon."""
        self.close()
        self.report.n_outages += 1
        self.pause_ns = FIRST_PAUSE_NS
        self.retry_ns = self.clock.now_ns() + self.pause_ns
        self.tell(Event(t_ns=self.clock.now_ns(), kind=BUS_LOST, detail=str(error)))

    def reopen(self, timeout_ns: int) -> bool:
        """Wait for the next attempt, at most ``timeout_ns``, and make it when its time has come.

        Returns whether the bus is back.
        """
        left_ns = self.retry_ns - self.clock.now_ns()
        if left_ns > 0:
            self.stop.wait(min(left_ns, timeout_ns) * 1e-9)
        if self.clock.now_ns() < self.retry_ns:
            return False
        try:
            self.attach(self.open_bus())
        except BusError:
            self.pause_ns = min(2 * self.pause_ns, LONGEST_PAUSE_NS)
            self.retry_ns = self.clock.now_ns() + self.pause_ns
            return False
        self.tell(Event(t_ns=self.clock.now_ns(), kind=BUS_BACK))
        return True

    def close(self) -> None:
        """Let go of the bus, whatever state it is in."""
        bus, self.bus, self.data_bus = self.bus, None, None
        self.pace_ns = 0
        if bus is not None:
            bus.close()

    def tell(self, event: Event) -> None:
        """Pass an event on, and obey it if it asks for the end."""
        if event.kind == STOP:
            self.stopping = True
        if self.watcher and isinstance(event.kind, BusFault):
            self.watcher.bus_news(event.t_ns, event)
        if self.on_event:
            self.on_event(event)

    def note_lateness(self, late_ns: int) -> None:
        """Keep how late a wake-up was."""
        if self.keep_late:
            late = self.report.late_ns
            late.append(late_ns)
            if len(late) >= 2 * self.keep_late:
                del late[: -self.keep_late]
