"""The one loop that owns a core on its real interfaces: waits, steps, sends, and outlives the buses.

A core's wake-up is met to a few microseconds where the machine lets it (SYNC jitter is contact jitter):
the thread sleeps until shortly before and polls the rest of the way. When a bus is lost the core goes on
being woken at its times, receives nothing from it, and what it sends there is lost; see ``line``.
"""

from __future__ import annotations

import select
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import InitVar, dataclass, field

from skinbus.bus.interface import Bus
from skinbus.bus.managed_interface import ManagedInterface
from skinbus.bus.monotonic_clock import MonotonicClock, sharpen_timers
from skinbus.bus.realtime import GcScheduler
from skinbus.can.clock import Clock
from skinbus.can.core import Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frames
from skinbus.errors import BusError

IDLE_NS = 100_000_000
"""Longest sleep, after which ``stop`` is looked at."""

POLL_NS = 150_000
"""Polling begins this long before a wake-up: what a sleep overshoots (median 60, p99 200 us when idle)."""

NAP_NS = 1_000_000
"""Several interfaces of which one cannot be waited for are looked at so often."""

PACED_FROM = 8
"""Data frames owed beyond which the loop sleeps through some of them: waking costs more than reading."""

SHORTEST_PACE_NS = 100_000
LONGEST_PACE_NS = 1_000_000
"""Such a sleep: long enough to be worth it, short enough to be no latency."""


@dataclass(slots=True)
class LoopReport:
    """What the loop did until it ended."""

    steps: int = 0
    n_received: int = 0
    n_sent: int = 0
    n_lost: int = 0
    """Frames of the core that did not go out."""
    n_outages: int = 0


@dataclass
class Loop:
    """Runs ``core`` on the buses that ``opens`` open until ``stop`` is set or the core sends a STOP event.

    There is one for each bus of the core. They are opened at once, each of them (else BusError); a bus lost
    later is opened again for as long as it takes, while the others go on.

    Args:
        on_step: called after each step, in the thread of the loop: short, please.
        on_event: called with each event of the core and of its interfaces.
        tidy: collects garbage, while the loop would sleep.
    """

    core: Core
    opens: InitVar[Sequence[Callable[[], Bus]]]
    stop: threading.Event
    clock: Clock = field(default_factory=MonotonicClock)
    on_step: Callable[[Step], object] | None = None
    on_event: Callable[[Event], object] | None = None
    tidy: GcScheduler | None = None
    report: LoopReport = field(default_factory=LoopReport)
    stopping: bool = False
    pace_ns: int = 0
    last_data_ns: int = 0

    def __post_init__(self, opens: Sequence[Callable[[], Bus]]) -> None:
        if len(opens) != self.core.n_buses:
            raise ValueError(f"{len(opens)} interfaces for a core on {self.core.n_buses} buses")
        self.lines = [
            ManagedInterface(k, self.core, open_bus, self.clock, self.take_news)
            for k, open_bus in enumerate(opens)
        ]
        try:
            for line in self.lines:
                line.open()
        except BusError:
            with suppress(BusError):
                self.close()
            raise

    def run(self) -> LoopReport:
        """The loop, the final frames and the end, each whatever the others do; the first error is raised."""
        sharpen_timers()
        errors: list[BaseException] = []
        for part in (self.loop, self.say_farewell, self.close):
            try:
                part()
            except BaseException as error:  # noqa: BLE001 - raised when all is done
                errors.append(error)
        if errors:
            for later in errors[1:]:
                errors[0].add_note(f"then: {later!r}")
            raise errors[0]
        for name in ("n_received", "n_sent", "n_lost", "n_outages"):
            setattr(self.report, name, sum(getattr(line, name) for line in self.lines))
        return self.report

    def loop(self) -> None:
        """Step and wait until it is time to end."""
        frames: Frames = ()
        while not self.stopping:
            wake_ns = self.step(frames)
            if not self.stopping:
                frames = self.wait(wake_ns)

    def say_farewell(self) -> None:
        """Send the last frames."""
        if frames := self.core.last_frames(self.clock.now_ns()):
            self.send(frames)

    def close(self) -> None:
        """Let go of all buses, also when one of them fails at it."""
        with ExitStack() as stack:
            for line in self.lines:
                stack.callback(line.close)

    def step(self, frames: Frames) -> int:
        """One step of the core, with all that follows from it; the time of its next one."""
        step = self.core.step(self.clock.now_ns(), frames)
        self.report.steps += 1
        for line in self.lines:
            line.follow()
        if step.frames:
            self.send(step.frames)
        for event in step.events:
            self.report_event(event)
        if self.on_step:
            self.on_step(step)
        return step.wake_ns

    def wait(self, wake_ns: int) -> Frames:
        """Frames for the core, or nothing when it is ``wake_ns``; returns early when asked to stop."""
        while not self.stop.is_set():
            left_ns = wake_ns - self.clock.now_ns()
            due = left_ns <= 0
            if left_ns > POLL_NS and self.tidy and not self.core.n_owed:
                self.tidy.pause(min(left_ns - POLL_NS, IDLE_NS))
                left_ns = wake_ns - self.clock.now_ns()
            timeout_ns = min(max(left_ns - POLL_NS, 0), IDLE_NS)
            frames = self.receive(timeout_ns)
            if frames is not None or due:
                return frames or ()
        self.stopping = True
        return ()

    def receive(self, timeout_ns: int) -> Frames | None:
        """What the core listens to of what is there, None if nothing came for it.

        Lost buses are opened again when it is time, and the wait ends then.
        """
        lost = [line for line in self.lines if line.bus is None]
        there = [line for line in self.lines if line.bus is not None]
        if lost:
            retry_ns = min(line.retry_ns for line in lost)
            timeout_ns = max(min(timeout_ns, retry_ns - self.clock.now_ns()), 0)
        if not there:
            self.wait_for((), timeout_ns)
        # Opening may take its time: what comes meanwhile on the others is read before the core's next step.
        came = [line.reopen() for line in lost]
        if any(frames is not None for frames in came):
            timeout_ns = 0
        if self.pace_ns and timeout_ns:
            self.wait_for(there, min(self.pace_ns, timeout_ns), for_data=False)
            timeout_ns = 0
        if len(there) == 1:
            came.append(there[0].receive(timeout_ns))
        elif there:
            came += [line.receive(0) for line in self.wait_for(there, timeout_ns)]
        self.set_pace()
        if all(frames is None for frames in came):
            return None
        return came[0] if len(came) == 1 else [frame for frames in came for frame in frames or ()]

    def wait_for(
        self, lines: Sequence[ManagedInterface], timeout_ns: int, *, for_data: bool = True
    ) -> list[ManagedInterface]:
        """Wait until one of the buses has frames, of the data plane only if wanted, or for so long.

        Returns those that may have some.
        """
        waited = [line.descriptors(for_data=for_data) for line in lines]
        if not lines or not all(waited):
            self.stop.wait((min(timeout_ns, NAP_NS) if lines else timeout_ns) * 1e-9)
            return list(lines)
        ready, _, _ = select.select([fd for fds in waited for fd in fds], (), (), timeout_ns * 1e-9)
        return [line for line, fds in zip(lines, waited, strict=True) if not set(fds).isdisjoint(ready)]

    def set_pace(self) -> None:
        """After data frames: sleep until half of what is owed has come, at the pace of the last ones."""
        batches = [line.bus.batch for line in self.lines if line.bus is not None and line.bus.batch.n]
        self.pace_ns = 0
        if not batches:
            return
        n = sum(batch.n for batch in batches)
        last_ns = max(int(batch.t_ns[batch.n - 1]) for batch in batches)
        owed = self.core.n_owed
        if owed > PACED_FROM:
            pace_ns = min(owed * (last_ns - self.last_data_ns) // (2 * n), LONGEST_PACE_NS)
            self.pace_ns = pace_ns if pace_ns >= SHORTEST_PACE_NS else 0
        self.last_data_ns = last_ns

    def send(self, frames: Frames) -> None:
        """Send the frames of the core, each on its bus."""
        if len(self.lines) == 1:
            self.lines[0].send(frames)
            return
        for line in self.lines:
            own = [frame for frame in frames if frame.bus == line.number]
            if own:
                line.send(own)

    def take_news(self, event: Event) -> None:
        """Pass an event of an interface on."""
        self.core.bus_news(event.t_ns, event)
        self.report_event(event)

    def report_event(self, event: Event) -> None:
        """Report an event, and end if it asks for that."""
        if event.kind is EventKind.STOP:
            self.stopping = True
        if self.on_event:
            self.on_event(event)
