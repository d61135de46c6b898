"""What every participant of a bus is: a core that takes time and frames and returns frames and events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

from skinbus.bus.frame import EXTENDED, Frame

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

        Numbers up to 0x7FF are 11-bit identifiers, larger ones 29-bit.
        """

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        """Take the frames received up to ``now_ns``; never raises for what they hold."""


def listens(cob_ids: frozenset[int] | None, frame: Frame) -> bool:
    """Whether a core with these ``cob_ids`` gets the frame; 29-bit 0x181 is not 11-bit 0x181."""
    if cob_ids is None:
        return True
    return frame.can_id in cob_ids and (frame.can_id > 0x7FF or not frame.flags & EXTENDED)
