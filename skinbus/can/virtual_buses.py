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
        plugs: list[tuple[VirtualBus, Port]] = []
        for k, wire in enumerate(self.wires):
            plugs.append((wire, wire.attach(_Plug(core, plugs, k), on_event=on_event)))
        ports = [port for _, port in plugs]
        plugs.append((self.wires[0], self.wires[0].attach(_Plug(core, plugs, None), on_event=on_event)))
        return ports

    def run(self, until_ns: int) -> None:
        """Let everything happen that happens up to and including ``until_ns``; then it is ``until_ns``."""
        while len(self.wires) > 1:  # they take turns
            first = min(self.wires, key=lambda wire: wire.next_ns)
            if first.next_ns > until_ns:
                break
            first.run(first.next_ns)
        for wire in self.wires:
            wire.run(until_ns)


class _Plug(Core):
    """A core as a port of one of its wires; without a number what wakes it, also when no port is attached."""

    def __init__(self, core: Core, plugs: list[tuple[VirtualBus, Port]], number: int | None) -> None:
        self._core, self._plugs, self._number = core, plugs, number
        self._has_data = number is None

    def cob_ids_on(self, bus: int) -> CobIds | None:
        """Identifiers that the core receives."""
        return frozenset() if self._number is None else self._core.cob_ids_on(self._number)

    def data_ids_on(self, bus: int) -> CobIds:
        """Identifiers of the core's data plane."""
        return frozenset() if self._number is None else self._core.data_ids_on(self._number)

    def take(self, now_ns: int, batch: FrameBatch) -> None:
        """Pass data frames of this wire on."""
        batch.frames["bus"][: batch.n] = self._number
        self._core.take(now_ns, batch)
        self._has_data = True

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Step the core with the frames of this wire, and queue what it sends."""
        if not (frames or self._has_data):
            return Step((), (), NEVER)
        self._has_data = self._number is None
        step = self._core.step(now_ns, [frame._replace(bus=self._number or 0) for frame in frames])
        *ports, (first, waker) = self._plugs
        for k, (wire, port) in enumerate(ports):
            wire.submit(port, now_ns, [frame for frame in step.frames if frame.bus == k])
        if self._number is None:
            return Step((), step.events, step.wake_ns)
        first.wake(waker, step.wake_ns)
        return Step((), step.events, NEVER)
