"""Several in-process wires on one clock, and cores that are on all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from skinbus.can.clock import VirtualClock
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event
from skinbus.can.frame import CobIds, FrameBatch, Frames
from skinbus.can.virtual_bus import Port, VirtualBus


class VirtualBuses:
    """VirtualBuses that run side by side; what happens first on any of them happens first."""

    def __init__(
        self,
        bitrates: Sequence[int],
        *,
        data_bitrates: Sequence[int | None] = (),
    ) -> None:
        """``data_bitrates`` make wires CAN FD, see ``VirtualBus``; by default none is."""
        self.clock = VirtualClock()
        pairs = zip(bitrates, data_bitrates or [None] * len(bitrates), strict=True)
        self.wires = [VirtualBus(bitrate, data_bitrate=fast, clock=self.clock) for bitrate, fast in pairs]

    def attach(self, core: Core, *, on_event: Callable[[Event], object] | None = None) -> list[Port]:
        """Put a core on all wires, on the first as its bus 0 and so on; the answer is its ports."""
        if len(self.wires) == 1:  # frames that the core waits for come together
            return [self.wires[0].attach(core, on_event=on_event)]
        waker = _Waker(core)
        plugs = [_Plug(waker, k) for k in range(len(self.wires))]
        ports = [wire.attach(plug, on_event=on_event) for wire, plug in zip(self.wires, plugs, strict=True)]
        waker.ports = list(zip(self.wires, ports, strict=True))
        waker.port = self.wires[0].attach(waker, on_event=on_event)
        return ports

    def run(self, until_ns: int) -> None:
        """Let everything happen that happens up to and including ``until_ns``; then it is ``until_ns``."""
        while (first := min(self.wires, key=lambda wire: wire.next_ns)).next_ns <= until_ns:
            first.run(first.next_ns)
        for wire in self.wires:
            wire.run(until_ns)


class _Waker(Core):
    """Steps a core; woken on the first wire, also when none of the core's own ports is attached."""

    def __init__(self, core: Core) -> None:
        self.core = core
        self.ports: list[tuple[VirtualBus, Port]] = []
        self.port: Port | None = None

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Step the core when it is time."""
        events, wake_ns = self.pass_on(now_ns, ())
        return Step((), events, wake_ns)

    def pass_on(self, now_ns: int, frames: Frames) -> tuple[Sequence[Event], int]:
        """Step the core and queue what it sends; return its events and when it is to be woken."""
        step = self.core.step(now_ns, frames)
        for k, (wire, port) in enumerate(self.ports):
            own = [frame for frame in step.frames if frame.bus == k]
            wire.submit(port, now_ns, own)
        return step.events, step.wake_ns


class _Plug(Core):
    """A core as a port of one of its wires."""

    def __init__(self, waker: _Waker, number: int) -> None:
        self._waker = waker
        self._number = number
        self._has_data = False

    def cob_ids_on(self, bus: int) -> CobIds | None:
        """Identifiers that the core receives."""
        return self._waker.core.cob_ids_on(self._number)

    def data_ids_on(self, bus: int) -> CobIds:
        """Identifiers of the core's data plane."""
        return self._waker.core.data_ids_on(self._number)

    def take(self, now_ns: int, batch: FrameBatch) -> None:
        """Pass data frames of this wire on."""
        batch.frames["bus"][: batch.n] = self._number
        self._waker.core.take(now_ns, batch)
        self._has_data = True

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Step the core with the frames of this wire."""
        if not (frames or self._has_data) or self._waker.port is None:
            return Step((), (), NEVER)
        self._has_data = False
        frames = [frame._replace(bus=self._number) for frame in frames]
        events, wake_ns = self._waker.pass_on(now_ns, frames)
        self._waker.ports[0][0].wake(self._waker.port, wake_ns)
        return Step((), events, NEVER)
