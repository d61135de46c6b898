"""A core that writes down all that is on its buses, and sends nothing."""

from __future__ import annotations

from skinbus.can.candump import CandumpWriter
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import CobIds, Frames


class Recorder(Core):
    """Listens to everything; a host keeps its buses open, and opens them again when they were lost."""

    cob_ids: CobIds | None = None

    def __init__(self, writer: CandumpWriter, n_buses: int) -> None:
        self.n_buses = n_buses
        self.n_dropped = 0
        """Frames that the machine had no room for."""
        self._writer = writer

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Write what was received, in the order of its reception on all buses together."""
        self._writer.write(sorted(frames, key=lambda frame: frame.t_ns) if self.n_buses > 1 else frames)
        return Step((), (), NEVER)

    def bus_news(self, now_ns: int, event: Event) -> None:
        """Write down what could not be."""
        if event.kind is EventKind.FRAMES_DROPPED:
            self.n_dropped += event.count
            self._writer.dropped(event.count, event.bus, self.n_dropped)
