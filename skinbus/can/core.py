"""What every participant of a bus is: a core that takes time and frames and returns frames and events.

A host passes frames on by two paths. Frames of the data plane (``data_ids_on``) come in batches to ``take``,
all others one by one to ``step``, which follows every ``take``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from skinbus.can.event import Event
from skinbus.can.frame import EXTENDED, NO_DATA, REMOTE_ID, RTR, CobIds, Frame, FrameBatch, Frames

NEVER = 2**63 - 1
"""A wake-up time that does not come (ns)."""


class Step(NamedTuple):
    """Answer of a core: frames to send in this order, events, and when to call again at the latest (ns)."""

    frames: Frames
    events: Sequence[Event]
    wake_ns: int


Output = tuple[list[Frame], list[Event]]
"""What a part of a core sends and reports."""


class Core:
    """A participant without I/O, clock or thread; the same on the virtual bus and on a real interface.

    A core overrides ``step`` and what else it needs; by default it is on one bus and receives nothing.
    """

    n_buses: int = 1
    """Buses that the core is on; frames say which by ``bus``."""

    @property
    def cob_ids(self) -> CobIds | None:
        """Identifiers received on the first bus, None for all; a new object whenever the set changes.

        Numbers up to 0x7FF are 11-bit identifiers, larger ones 29-bit; see ``receives``.
        """
        return frozenset()

    def cob_ids_on(self, bus: int) -> CobIds | None:
        """Identifiers received on a bus, as ``cob_ids``."""
        return self.cob_ids

    def data_ids_on(self, bus: int) -> CobIds:
        """Identifiers of the data plane on a bus, part of ``cob_ids_on``; they stay the same."""
        return frozenset()

    @property
    def n_owed(self) -> int:
        """Frames of the data plane that the core waits for; 0 when none is urgent."""
        return 0

    def take(self, now_ns: int, batch: FrameBatch) -> None:
        """Take frames of the data plane; ``step`` follows."""

    def bus_news(self, now_ns: int, event: Event) -> None:
        """Take an event of the interface to a bus; ``step`` follows."""

    def not_sent(self, now_ns: int, frames: Frames) -> None:
        """Take frames of this core that a full queue or a lost bus discarded, oldest first."""

    def step(self, now_ns: int, frames: Frames) -> Step:
        """Take the frames received up to ``now_ns``; never raises for their content."""
        raise NotImplementedError

    def last_frames(self, now_ns: int) -> Frames:
        """Return the frames to send at the end; a host asks for them when there are no more steps."""
        return ()


def receives(cob_ids: CobIds | None, frame: Frame) -> bool:
    """Return whether a core with these ``cob_ids`` gets the frame; 29-bit 0x181 is not 11-bit 0x181.

    CANopen services are data frames. A remote frame reaches a core that receives everything or its identifier
    with ``REMOTE_ID``, an error frame only one that receives everything.
    """
    if cob_ids is None:
        return True
    can_id, flags = frame.can_id, frame.flags
    if flags == RTR:
        return can_id | REMOTE_ID in cob_ids
    return can_id in cob_ids and (
        not flags or not (flags & NO_DATA or (flags & EXTENDED and can_id <= 0x7FF))
    )


class DataQueue:
    """Frames of the data plane that arrive one by one, on their way to a core as a batch."""

    __slots__ = ("_batch", "_core", "_frames")

    def __init__(self, core: Core) -> None:
        self._core = core
        self._frames: list[Frame] = []
        n_ids = sum(len(core.data_ids_on(bus)) for bus in range(core.n_buses))
        self._batch = FrameBatch(max(n_ids, 1))

    def append(self, frame: Frame) -> bool:
        """Add a frame; return whether to pass them on: the core waits for no more, or the queue is full."""
        self._frames.append(frame)
        return len(self._frames) >= min(max(self._core.n_owed, 1), len(self._batch.frames))

    def pass_on(self, now_ns: int) -> None:
        """Let the core take all of them; ``step`` follows."""
        if self._frames:
            self._batch.n = 0
            self._batch.extend(self._frames)
            self._frames.clear()
            self._core.take(now_ns, self._batch)
