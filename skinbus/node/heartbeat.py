"""The heartbeat producer: one frame with the NMT state every 0x1017 milliseconds."""

from __future__ import annotations

from skinbus.can.core import NEVER
from skinbus.node.context import NS_PER_MS, Context, Part
from skinbus.objects.cia import HEARTBEAT_BASE, HEARTBEAT_PRODUCER, NmtState


class HeartbeatProducer(Part):
    """Says that this device lives, and in which state."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.dictionary.watchers[HEARTBEAT_PRODUCER] = self._changed

    def boot_up(self) -> None:
        """Send the boot-up message, which is the first heartbeat (CiA 301, 7.2.8.3.2.2)."""
        self._send()
        self.wake_ns = self.context.now_ns + self._period_ns if self._period_ns else NEVER

    def reset(self) -> None:
        """Fall silent until the next boot-up."""
        self.wake_ns = NEVER

    def tick(self) -> None:
        """Send when it is time; beats that were missed are not made up for."""
        if self.context.now_ns >= self.wake_ns:
            self._send()
            self.wake_ns += self._period_ns
            if self.wake_ns <= self.context.now_ns:
                self.wake_ns = self.context.now_ns + self._period_ns

    def _changed(self, sub: int) -> None:
        """A time that is written starts the heartbeat at once."""
        if self.context.state is not NmtState.INITIALISING:
            self.wake_ns = self.context.now_ns if self._period_ns else NEVER

    @property
    def _period_ns(self) -> int:
        return self.values.number(HEARTBEAT_PRODUCER, 0) * NS_PER_MS

    def _send(self) -> None:
        self.context.send(HEARTBEAT_BASE + self.context.node_id, bytes((self.context.state,)))
