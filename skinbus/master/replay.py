"""A recording through the master: its frames, in their order and on their own time, in and contacts out.

No clock and no chance: the same frames give the same contacts, as fast as the machine can. The master
follows: the SYNCs and the boots of patches are those of the recording, wherever it begins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from skinbus.can.classic import INTERFRAME_BITS
from skinbus.can.core import DataQueue, receives
from skinbus.can.event import Event
from skinbus.can.frame import ERROR, EXTENDED, NO_DATA, Frame, Frames
from skinbus.can.wire_bits import frame_bits
from skinbus.master.cycle import CycleReport
from skinbus.master.master import Master
from skinbus.model import Arm
from skinbus.node.sync import MAX_COUNTER
from skinbus.objects import cia
from skinbus.objects.published import usual

LEAST_PAUSES = 3
"""Between cycles, from which their rate is found."""

LOWEST_HZ = 1.0
HIGHEST_HZ = 10_000.0
"""Of an arm file, and of a bus."""


class Sync(NamedTuple):
    """What cycles begin with in a recording."""

    bus: int | None
    """Whose SYNCs, those of the first bus that has some; None: there are none."""
    rate_hz: float | None
    """How often; None when that cannot be determined."""


def find_sync(frames: Iterable[Frame]) -> Sync:
    """Look for it in the frames with which a recording begins."""
    syncs: dict[int, list[int]] = {}
    for frame in frames:
        if frame.can_id == cia.SYNC_ID and not frame.flags:
            syncs.setdefault(frame.bus, []).append(frame.t_ns)
    bus = min(syncs, default=None)
    pauses = np.diff(np.array(syncs.get(bus or 0, []), object)).astype(np.float64)
    if len(pauses) < LEAST_PAUSES or not (middle := float(np.median(pauses))) > 0.0:
        return Sync(bus, None)
    return Sync(bus, min(max(1e9 / middle, LOWEST_HZ), HIGHEST_HZ))


LONGEST_GAP_NS = 60_000_000_000
"""What passes without a frame is passed over beyond this: nothing of a contact is left by then."""

USUAL_GAP_NS = 2_000_000_000
"""A bus with a master is never silent for so long."""

JITTER_NS = 1_000_000_000
"""Frames of several interfaces may stand in a recording in another order than they came, but not by more."""


class Timeline:
    """The time of a recording, made one that never goes back; its zero is the first frame."""

    def __init__(self) -> None:
        self.n_jumps = 0
        """Times that the clock of the recorder was set."""
        self.now_ns = 0
        self._shift_ns: int | None = None

    def at(self, t_ns: int) -> int:
        """Move to the time of a frame, and return it."""
        if self._shift_ns is None:
            self._shift_ns = -t_ns
        moved_ns = t_ns + self._shift_ns - self.now_ns
        if not -JITTER_NS <= moved_ns <= USUAL_GAP_NS:
            self.n_jumps += not 0 < moved_ns <= LONGEST_GAP_NS
            self._shift_ns += min(max(moved_ns, 0), LONGEST_GAP_NS) - moved_ns
        self.now_ns = max(self.now_ns, t_ns + self._shift_ns)
        return self.now_ns


@dataclass(slots=True)
class Taken:
    """Frames of a recording, by what they are."""

    n_readings: int = 0
    """With an identifier that carries readings of the arm."""
    n_others: int = 0
    n_remote: int = 0
    n_error: int = 0


class Replay:
    """Hands the frames of a recording to a master that follows."""

    def __init__(
        self,
        arm: Arm,
        *,
        sync_bus: int | None = 0,
        on_cycle: Callable[[CycleReport], None] = lambda report: None,
        on_event: Callable[[Event], object] = lambda event: None,
        **settings: Any,
    ) -> None:
        """Begin.

        sync_bus:  whose SYNCs are followed; None: those of the bus on which the first one comes
        on_event:  called with what it detects
        settings:  of the master: level, node_id, zero_at_start
        """
        self.master = master = Master(arm, follows=True, on_cycle=on_cycle, **settings)
        self.timeline = Timeline()
        self.taken = Taken()
        self.stamp_ns = 0
        """What to add to the time of a cycle to get that of the recording, in ``on_cycle``."""
        self._sync_bus = sync_bus
        self._on_event = on_event
        self._data_ids = [master.data_ids_on(k) for k in range(master.n_buses)]
        self._data = DataQueue(master)
        self._stepped_ns = 0
        self._wake_ns = 0
        self._summary_id = usual(master.device.node_id).summary.cob_id
        self._counter = 0
        for branch in master.branches:  # every SYNC is given a counter
            branch.sync_counter = MAX_COUNTER

    def take(self, frame: Frame) -> None:
        """Take the next frame; its ``bus`` is one of the master's."""
        can_id, data, t_ns, flags, bus = frame
        if flags & NO_DATA:
            self.taken.n_error += bool(flags & ERROR)
            self.taken.n_remote += not flags & ERROR
            return
        now_ns = self.timeline.at(t_ns)
        if not self.master.gather.is_open:
            self.stamp_ns = t_ns - now_ns
        if can_id in self._data_ids[bus] and not flags & EXTENDED:
            self.taken.n_readings += 1
            self._wake_until(now_ns)
            if self._data.append(Frame(can_id, data, now_ns, flags, bus)):
                self._step(now_ns, ())
            return
        self.taken.n_others += 1
        if can_id == self._summary_id and data and not flags:
            self._counter = data[0]  # of the SYNC before: a SYNC without counter is counted on from here
        if can_id == cia.SYNC_ID and not flags:
            if self._sync_bus is None:
                self._sync_bus = bus
            if bus == self._sync_bus:
                self._sync(now_ns, frame)
        elif receives(self.master.cob_ids_on(bus), frame):
            self._wake_until(now_ns)
            self._step(now_ns, (frame._replace(t_ns=now_ns),))

    def end(self) -> None:
        """Close the open cycle: there are no more frames."""
        self._step(self._stepped_ns, ())
        while self.master.gather.is_open:
            self._step(self._wake_ns, ())

    def _sync(self, now_ns: int, frame: Frame) -> None:
        """Begin a cycle when its SYNC began, as a master does; a recording has the times of the ends."""
        bits = frame_bits(frame) - INTERFRAME_BITS
        begin_ns = max(now_ns - bits * 1_000_000_000 // self.master.arm.buses[frame.bus].bitrate, 0)
        self._wake_until(begin_ns)
        begin_ns = max(begin_ns, self._stepped_ns)
        self.stamp_ns = frame.t_ns - begin_ns
        # one without a counter is given the next
        self._counter = frame.data[0] if frame.data else self._counter % MAX_COUNTER + 1
        self._step(begin_ns, (Frame(cia.SYNC_ID, bytes([self._counter]), begin_ns),))

    def _wake_until(self, now_ns: int) -> None:
        """Let the master do what is due before a frame comes."""
        while self._wake_ns < now_ns:
            self._step(self._wake_ns, ())

    def _step(self, now_ns: int, frames: Frames) -> None:
        """Give the master what waits for it and these frames."""
        self._data.pass_on(now_ns)
        step = self.master.step(now_ns, frames)
        self._stepped_ns = now_ns
        self._wake_ns = max(step.wake_ns, now_ns + 1)
        for event in step.events:
            self._on_event(event)
