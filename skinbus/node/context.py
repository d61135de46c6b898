"""What the services of one device share: values, node-ID, state, time, and what goes out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from skinbus.can.core import NEVER
from skinbus.can.event import Event, EventKind
from skinbus.can.fd import CLASSIC_BYTES
from skinbus.can.frame import LONG, Frame
from skinbus.node.dictionary import Dictionary
from skinbus.node.values import Values
from skinbus.objects.cia import NmtState

if TYPE_CHECKING:
    from skinbus.node.emcy import EmcyService

Handler = Callable[[Frame], None]
Handlers = dict[int, Handler]
"""By identifier."""

NS_PER_MS = 1_000_000
NS_PER_100US = 100_000

_make_frame = tuple.__new__  # half the time of Frame(...); this is the innermost loop of a simulated skin


class Context:
    """Written by the device before it calls a service; services add frames and events."""

    emcy: EmcyService
    listen: Callable[[], None]
    """To be called when what a service listens to may have changed."""
    on_loss: Callable[[], None]
    """Called when a heartbeat or guarding is lost."""

    def __init__(self, values: Values, node_id: int) -> None:
        self.values = values
        self.dictionary = Dictionary(values)
        self.node_id = node_id
        self.state = NmtState.INITIALISING
        self.now_ns = 0
        self.out: list[Frame] = []
        self.events: list[Event] = []
        self.dropped = 0

    def send(self, can_id: int, data: bytes) -> None:
        """Queue one frame; frames leave in the order of the calls."""
        flags = LONG if len(data) > CLASSIC_BYTES else 0
        self.out.append(_make_frame(Frame, (can_id, data, self.now_ns, flags, 0)))

    def report(self, kind: EventKind, detail: str = "", node_id: int | None = None) -> None:
        """Report to the host; ``node_id`` is this device unless it is about another one."""
        node_id = self.node_id if node_id is None else node_id
        self.events.append(Event(self.now_ns, kind, node_id=node_id, detail=detail))

    def drop(self, frame: Frame, reason: str) -> None:
        """Count a frame that broke a rule; nothing else changes."""
        self.dropped += 1
        self.report(EventKind.DROPPED, f"0x{frame.can_id:03X} [{len(frame.data)}]: {reason}")


class Part:
    """A service of a device."""

    wake_ns = NEVER
    """When it has something to do, ns."""

    def __init__(self, context: Context) -> None:
        self.context = context
        self.values = context.values
        self.dictionary = context.dictionary
        self.emcy = context.emcy
