"""What every participant of a bus is: a core that takes time and frames and returns frames and events."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Final, NamedTuple, Protocol, runtime_checkable

from skinbus.can.frame import EXTENDED, NO_DATA, Frame, FrameBatch

NEVER: Final = 2**63 - 1
"""A wake-up time that does not come (ns)."""

STOP: Final = "stop"
"""Kind of the event by which a core asks its host to end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something a core noticed and its host may want to know: a change of state, a dropped frame, a fault."""

    t_ns: int
    kind: str
    node_id: int = 0
    detail: str = ""
    count: int = 0
    """How many, where things are counted."""
    cob_id: int = 0
    """Whose frames, where it is about frames of one identifier."""
    bus: int = 0
    """Number of the bus, where the core is on several."""


class BusFault(StrEnum):
    """Kinds of events that tell of the bus itself: what came, and what went."""

    LOST = "bus-lost"
    BACK = "bus-back"
    BUS_OFF = "bus-off"
    BUS_OFF_END = "bus-off-end"
    PASSIVE = "error-passive"
    PASSIVE_END = "error-passive-end"
    WARNING = "error-warning"
    WARNING_END = "error-warning-end"
    OVERFLOW = "frames-dropped"
    """Received frames that the machine had no room for; ``count`` of them."""
    CONTROLLER_OVERFLOW = "controller-overflow"
    SEND_QUEUE_FULL = "send-queue-full"
    SEND_QUEUE_FULL_END = "send-queue-full-end"
    BABBLING = "babbling"
    """Somebody sends ``count`` frames a second under ``cob_id``, more than half of all."""
    BABBLING_END = "babbling-end"

    @property
    def end(self) -> BusFault:
        """The kind that tells of this fault's end."""
        return BusFault(f"{self.value}-end")


class Step(NamedTuple):
    """Answer of a core: frames to send in this order, events, and when to call again at the latest (ns)."""

    frames: Sequence[Frame]
    events: Sequence[Event]
    wake_ns: int


class Core(Protocol):
    """A participant without I/O, clock or thread; the same on the in-process wire and on a real interface."""

    @property
    def cob_ids(self) -> frozenset[int] | None:
        """Identifiers this core listens to, None for all; a new object whenever the set changes.

        Numbers up to 0x7FF are 11-bit identifiers, larger ones 29-bit; see ``listens``.
        """

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take the frames received up to ``now_ns``; never raises for what they hold."""


@runtime_checkable
class ManyBusCore(Core, Protocol):
    """A core that is on several buses; its frames carry the number of theirs."""

    @property
    def n_buses(self) -> int:
        """How many."""

    def cob_ids_on(self, bus: int) -> frozenset[int] | None:
        """Identifiers this core listens to on a bus, as ``cob_ids``, which is that of the first."""


@runtime_checkable
class DataCore(Core, Protocol):
    """A core that takes the frames of its data plane in batches, where the bus has them."""

    def data_ids_on(self, bus: int) -> frozenset[int]:
        """Identifiers of the data plane on a bus, part of those that it listens to there."""

    @property
    def n_owed(self) -> int:
        """Data-plane frames that the core waits for; 0 when none is urgent."""

    def take(self, now_ns: int, batch: FrameBatch) -> None:
        """Take data-plane frames; ``step`` follows."""


@runtime_checkable
class BusWatcher(Protocol):
    """A core that wants to hear of the bus's faults."""

    def bus_news(self, now_ns: int, event: Event) -> None:
        """Take an event whose kind is a ``BusFault``; ``step`` follows."""


@runtime_checkable
class SendWatcher(Protocol):
    """A core that wants to know which of its frames did not go out."""

    def not_sent(self, now_ns: int, frames: Sequence[Frame]) -> None:
        """Take frames that a full queue or a lost bus swallowed, oldest first."""


def cob_ids_of(core: Core, bus: int) -> Callable[[], frozenset[int] | None]:
    """Return what asks a core for the identifiers that it listens to on a bus."""
    if isinstance(core, ManyBusCore):
        return partial(core.cob_ids_on, bus)
    return lambda: core.cob_ids


def n_buses(core: Core) -> int:
    """On how many buses a core is."""
    return core.n_buses if isinstance(core, ManyBusCore) else 1


def listens(cob_ids: frozenset[int] | None, frame: Frame) -> bool:
    """Whether a core with these ``cob_ids`` gets the frame; 29-bit 0x181 is not 11-bit 0x181.

    What CANopen says is said in data frames. A remote or error frame with the identifier of a heartbeat is
    none, and reaches only who listens to all.
    """
    if cob_ids is None:
        return True
    can_id, flags = frame.can_id, frame.flags
    return can_id in cob_ids and (
        not flags or not (flags & NO_DATA or (flags & EXTENDED and can_id <= 0x7FF))
    )
