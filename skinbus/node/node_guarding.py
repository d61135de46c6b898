"""Node guarding: the state, with a bit that toggles, in answer to remote frames; life guarding beside it.

Source: CiA 301, 7.2.8.2.2 and 7.2.8.3.2.1. A device whose heartbeat runs (0x1017) is not guarded.
"""

from __future__ import annotations

from skinbus.can.core import NEVER
from skinbus.can.event import EventKind
from skinbus.can.frame import REMOTE_ID, Frame
from skinbus.node.context import NS_PER_MS, Context, Handlers, Part
from skinbus.node.nmt import Service
from skinbus.objects.cia import (
    GUARD_TIME,
    HEARTBEAT_BASE,
    HEARTBEAT_PRODUCER,
    LIFE_TIME_FACTOR,
    EmcyCode,
)

TOGGLE = 0x80


class NodeGuarding(Part):
    """Answers the guarding of a master, and reports when it ends (0x100C times 0x100D)."""

    kind = Service.ERROR_CONTROL

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.reset()
        for index in (GUARD_TIME, LIFE_TIME_FACTOR):
            self.dictionary.watchers[index] = self._changed

    def reset(self) -> None:
        """Begin anew: the first answer after a boot has the bit cleared, and no life time runs until then."""
        self._toggle = 0
        self.wake_ns = NEVER

    def handlers(self) -> Handlers:
        """The remote frames with the identifier of the own heartbeat."""
        can_id = REMOTE_ID | (HEARTBEAT_BASE + self.context.node_id)
        return {can_id: self._answer} if GUARD_TIME in self.dictionary.layout.indices else {}

    def tick(self) -> None:
        """Report that the master has stopped guarding."""
        if self.context.now_ns >= self.wake_ns:
            self.wake_ns = NEVER
            self.context.report(EventKind.GUARDING_LOST)
            self.emcy.raise_error(EmcyCode.HEARTBEAT)
            self.context.on_loss()

    def _answer(self, frame: Frame) -> None:
        if self.values.number(HEARTBEAT_PRODUCER, 0):
            return
        context = self.context
        context.send(HEARTBEAT_BASE + context.node_id, bytes((context.state | self._toggle,)))
        self._toggle ^= TOGGLE
        self.emcy.clear_error(EmcyCode.HEARTBEAT, b"")
        self.wake_ns = context.now_ns + self._life_ns() if self._life_ns() else NEVER

    def _life_ns(self) -> int:
        return self.values.number(GUARD_TIME, 0) * self.values.number(LIFE_TIME_FACTOR, 0) * NS_PER_MS

    def _changed(self, sub: int) -> None:
        """Stop watching when there is no life time; another one counts from the next guarding."""
        if not self._life_ns():
            self.wake_ns = NEVER
