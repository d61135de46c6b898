"""An in-process CAN bus on a virtual clock that does what a wire does: arbitration and frame time.

Whoever has something to send when the bus becomes free takes part in arbitration; the lowest identifier
wins, a data frame before a remote frame, a standard before an extended one. A frame once begun is not
interrupted. It becomes visible to all others at the end of its last bit; three bits later the bus is free
again. The wire acknowledges every frame, even with nobody else there. All is deterministic: at one
instant deliveries come first, then wake-ups in the order of attachment, then arbitration.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from heapq import heappop, heappush

from skinbus.can.arbitration import BUS_OFF, ERROR_PENALTY, arbitration_key, collide
from skinbus.can.classic import INTERFRAME_BITS
from skinbus.can.clock import VirtualClock
from skinbus.can.core import NEVER, Core, DataQueue, receives
from skinbus.can.event import Event
from skinbus.can.fd import worst_case_bits
from skinbus.can.frame import BRS, FD, Frame, Frames
from skinbus.can.wire_bits import classic_bits, fault

Tap = Callable[[Frame], object]
OnEvent = Callable[[Event], object]

MAX_BITRATE = 1_000_000
QUEUE_LIMIT = 4096
"""Frames that a port may hold back; further ones are refused."""

_LONGEST_BITS = 256
"""More than the longest classic frame (160 bits) or collision of such, or nominal phase of CAN FD."""


class Port:
    """Where a core meets the wire; made by ``VirtualBus.attach``."""

    def __init__(self, index: int, core: Core, on_event: OnEvent | None) -> None:
        self.index = index
        self.core = core
        self.on_event = on_event
        self.cob_ids = core.cob_ids_on(0)
        self.data = DataQueue(core)
        self.data_ids = core.data_ids_on(0)
        self.wake_ns = NEVER
        self.attached = True
        self.queued = 0
        """Frames waiting for the bus."""
        self.error_counter = 0
        """Transmit error counter; see ``collision``."""

    @property
    def bus_off(self) -> bool:
        """Whether errors have taken the port off the bus."""
        return self.error_counter >= BUS_OFF


_Waiting = tuple[Port, Frame]  # sender, frame


class VirtualBus:
    """The bus; ``run(until_ns)`` moves its clock and everything on it."""

    def __init__(
        self,
        bitrate: int = MAX_BITRATE,
        *,
        data_bitrate: int | None = None,
        clock: VirtualClock | None = None,
    ) -> None:
        """An empty bus; ``data_bitrate`` is that of the data phase of CAN FD, None for classic CAN."""
        if not 0 < bitrate <= MAX_BITRATE:
            raise ValueError(f"bitrate is {bitrate}; wanted 1..{MAX_BITRATE}")
        if data_bitrate is not None and data_bitrate < bitrate:
            raise ValueError(f"data_bitrate is {data_bitrate}; wanted at least bitrate, {bitrate}")
        self.bitrate = bitrate
        self.data_bitrate = data_bitrate
        self.clock = clock or VirtualClock()
        self.ports: list[Port] = []
        self.collide = collide
        """How frames that are sent at once end; another function may destroy one, as a bit error does."""
        self._ns_of_bits = [round(bits * 1_000_000_000 / bitrate) for bits in range(_LONGEST_BITS)]
        self.now_ns = self.clock.now_ns()
        """Time on the wire (ns)."""
        self._taps: tuple[Tap, ...] = ()
        self._listeners: dict[tuple[int, int], tuple[Port, ...]] = {}  # by identifier and flags
        self._wakes: list[tuple[int, int]] = []  # heap of (time, port); an entry may be outdated
        self._queues: dict[int, deque[_Waiting]] = {}  # by arbitration key, those with frames
        self._flight: tuple[_Waiting, ...] = ()  # what is on the wire: one frame, equal ones of several ports
        self._flight_end_ns = 0
        self._free_ns = self.now_ns

    def attach(self, core: Core, *, on_event: OnEvent | None = None) -> Port:
        """Put a core on the bus; it is woken at once when the wire next runs."""
        port = Port(len(self.ports), core, on_event)
        self.ports.append(port)
        self._listeners.clear()
        self._wake(port, self.now_ns)
        return port

    def detach(self, port: Port) -> None:
        """Pull the plug of a port; what it still held back is gone. A frame on the wire is finished."""
        port.attached = False
        port.wake_ns = NEVER
        self._listeners.clear()
        self._drop_waiting(port)

    def restart(self, port: Port) -> None:
        """Plug a detached port in again, or end its bus-off; its core is woken at once."""
        port.attached = True
        port.error_counter = 0
        self._listeners.clear()
        self._wake(port, self.now_ns)

    def wake(self, port: Port, wake_ns: int = 0) -> None:
        """Call the core of the port at a time, or when the wire next runs: for hosts that have a reason."""
        if port.attached:
            self._wake(port, max(wake_ns, self.now_ns))

    def submit(self, port: Port, now_ns: int, frames: Frames) -> None:
        """Queue frames of a core that is on other wires too, and was stepped there."""
        if port.attached and frames:
            self._queue(port, frames)
            self.now_ns = max(self.now_ns, now_ns)
        self._follow(port)

    def tap(self, listen: Tap) -> None:
        """Let ``listen`` see every frame at the end of its last bit."""
        self._taps += (listen,)

    @property
    def next_ns(self) -> int:
        """When something happens next (ns)."""
        next_ns = self._wakes[0][0] if self._wakes else NEVER
        if self._flight:
            return min(next_ns, self._flight_end_ns)
        return min(next_ns, max(self._free_ns, self.now_ns)) if self._queues else next_ns

    def run(self, until_ns: int) -> None:
        """Let everything happen that happens up to and including ``until_ns``; then it is ``until_ns``."""
        while (next_ns := self.next_ns) <= until_ns:
            if next_ns > self.now_ns:
                self.now_ns = next_ns
                self.clock.move_to(next_ns)
            if self._flight and self._flight_end_ns == next_ns:
                self._deliver(next_ns)
            while self._wakes and self._wakes[0][0] <= next_ns:
                wake_ns, index = heappop(self._wakes)
                port = self.ports[index]
                if port.wake_ns == wake_ns:
                    port.wake_ns = NEVER
                    self._step(port, next_ns, ())
            if self._queues and not self._flight and self._free_ns <= next_ns:
                self._arbitrate(next_ns)
        if until_ns > self.now_ns:
            self.now_ns = until_ns
            self.clock.move_to(until_ns)

    def _wake(self, port: Port, wake_ns: int) -> None:
        if wake_ns != port.wake_ns:
            port.wake_ns = wake_ns
            if wake_ns < NEVER:
                heappush(self._wakes, (wake_ns, port.index))

    def _step(self, port: Port, now_ns: int, frames: Frames) -> None:
        """Give a core frames or just the time, and take what it has to send."""
        port.data.pass_on(now_ns)
        frames, events, wake_ns = port.core.step(now_ns, frames)
        if frames:
            self._queue(port, frames)
        if events and port.on_event:
            for event in events:
                port.on_event(event)
        # A core that is to be called at once gets the next bit, so that time goes on.
        self._wake(port, wake_ns if wake_ns > now_ns else now_ns + self._ns_of_bits[1])
        self._follow(port)

    def _follow(self, port: Port) -> None:
        """Listen to what the core listens to now."""
        if (cob_ids := port.core.cob_ids_on(0)) is not port.cob_ids:
            port.cob_ids = cob_ids
            self._listeners.clear()

    def _queue(self, port: Port, frames: Frames) -> None:
        """Put frames into the port's queue: by identifier, within one identifier in their order."""
        fd = self.data_bitrate is not None
        for frame in frames:
            if port.queued >= QUEUE_LIMIT or port.bus_off or fault(frame, fd=fd):
                continue
            port.queued += 1
            key = arbitration_key(frame)
            self._queues.setdefault(key, deque()).append((port, frame))

    def _arbitrate(self, now_ns: int) -> None:
        """Let all ports that offer the lowest key begin together; what gets through, if anything, is sent."""
        key = min(self._queues)
        queue, firsts = self._queues[key], dict[int, _Waiting]()
        for waiting in queue:
            firsts.setdefault(waiting[0].index, waiting)
        contenders = list(firsts.values())
        winners, failed, lost_bits = self.collide(
            [frame for _, frame in contenders], [port.error_counter for port, _ in contenders]
        )
        self._flight = tuple(contenders[i] for i in winners)
        for waiting in self._flight:
            queue.remove(waiting)
        if not queue:
            del self._queues[key]
        if failed:
            self._free_ns = now_ns + self._ns_of_bits[lost_bits]
            for i in failed:
                port, _ = contenders[i]
                port.error_counter += ERROR_PENALTY
                if port.bus_off:
                    self._drop_waiting(port)
                    self._listeners.clear()
        if self._flight:
            end_ns, duration_ns = self._frame_ns(self._flight[0][1])
            self._flight_end_ns, self._free_ns = now_ns + end_ns, now_ns + duration_ns

    def _deliver(self, now_ns: int) -> None:
        """The last bit has passed: let everybody else see the frame."""
        flight, self._flight = self._flight, ()
        can_id, data, _, flags, _ = flight[0][1]
        frame = Frame(can_id, data, now_ns, flags)
        senders = [sender for sender, _ in flight]
        for sender in senders:
            sender.queued -= 1
            if sender.error_counter:
                sender.error_counter -= 1
        for tap in self._taps:
            tap(frame)
        listeners = self._listeners.get((can_id, flags))
        if listeners is None:
            listeners = self._listeners[can_id, flags] = self._find_listeners(frame)
        for port in listeners:
            if port not in senders and port.attached:
                if not receives(port.data_ids, frame):
                    self._step(port, now_ns, (frame,))
                elif port.data.append(frame):
                    self._step(port, now_ns, ())

    def _find_listeners(self, frame: Frame) -> tuple[Port, ...]:
        """Ports that want frames with this identifier and these flags."""
        return tuple(
            port
            for port in self.ports
            if port.attached and not port.bus_off and receives(port.cob_ids, frame)
        )

    def _frame_ns(self, frame: Frame) -> tuple[int, int]:
        """Time to the last bit of a frame, and with the interframe space (ns); of CAN FD at worst."""
        if frame.flags & FD and self.data_bitrate:
            fast = self.data_bitrate if frame.flags & BRS else self.bitrate
            duration_ns = worst_case_bits(len(frame.data)).ns(self.bitrate, fast)
            return duration_ns - self._ns_of_bits[INTERFRAME_BITS], duration_ns
        bits = classic_bits(frame.can_id, frame.data, frame.flags)
        return self._ns_of_bits[bits - INTERFRAME_BITS], self._ns_of_bits[bits]

    def _drop_waiting(self, port: Port) -> None:
        for key, queue in list(self._queues.items()):
            kept = deque(waiting for waiting in queue if waiting[0] is not port)
            port.queued -= len(queue) - len(kept)
            self._queues[key] = kept
            if not kept:
                del self._queues[key]
