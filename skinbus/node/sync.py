"""SYNC: consumed, and produced every 0x1006 microseconds when 0x1005 says so; its counter and its window."""

from __future__ import annotations

from collections.abc import Callable

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.node.context import Context, Handlers, Part
from skinbus.node.dictionary import SdoAbort, check_cob_id
from skinbus.node.nmt import Service
from skinbus.objects.cia import (
    COB_ID_INVALID,
    COB_ID_MASK_11,
    COB_ID_PRODUCER,
    SYNC_COB_ID,
    SYNC_COUNTER_OVERFLOW,
    SYNC_PERIOD,
    SYNC_WINDOW,
    AbortCode,
    EmcyCode,
    NmtState,
)

NS_PER_US = 1_000
MAX_COUNTER = 240


class SyncService(Part):
    """Calls ``on_sync(counter)`` for every SYNC, received or produced; 0 is a SYNC without counter."""

    kind = Service.SYNC

    _overflow = _counter = _cob_id = _period_ns = _window_ns = 0
    _produces = False
    _closes_ns = NEVER

    def __init__(self, context: Context, on_sync: Callable[[int], None]) -> None:
        super().__init__(context)
        self.on_sync = on_sync
        self.dictionary.rules[SYNC_COB_ID] = self._check_cob_id
        self.dictionary.rules[SYNC_COUNTER_OVERFLOW] = self._check_overflow
        for index in (SYNC_COB_ID, SYNC_PERIOD, SYNC_WINDOW, SYNC_COUNTER_OVERFLOW):
            self.dictionary.watchers[index] = self._changed

    def configure(self) -> None:
        """Take over the parameters, as after a reset; a producer begins one period from now."""
        number = self.values.number
        cob_id = number(SYNC_COB_ID, 0)
        self._cob_id = cob_id & COB_ID_MASK_11
        self._overflow = number(SYNC_COUNTER_OVERFLOW, 0)
        self._period_ns = number(SYNC_PERIOD, 0) * NS_PER_US
        self._produces = bool(cob_id & COB_ID_PRODUCER and self._period_ns)
        self._window_ns = number(SYNC_WINDOW, 0) * NS_PER_US
        if not self._window_ns:
            self._closes_ns = NEVER
        self._plan()

    def enter(self, state: NmtState) -> None:
        """The counter starts at 1 after STOPPED (CiA 301, 7.2.5)."""
        if state in (NmtState.STOPPED, NmtState.INITIALISING):
            self._counter = 0
            self.wake_ns = NEVER
            self._closes_ns = NEVER
        elif self.wake_ns == NEVER:
            self._plan()

    def in_window(self) -> bool:
        """Return whether synchronous PDOs of the last SYNC may still be sent and taken (CiA 301, 7.5.2.7)."""
        return self.context.now_ns <= self._closes_ns

    def handlers(self) -> Handlers:
        """A producer does not listen to the SYNC of others."""
        return {} if self._produces else {self._cob_id: self.receive}

    def receive(self, frame: Frame) -> None:
        """One SYNC from the bus."""
        data = frame.data
        self.emcy.report(EmcyCode.SYNC_LENGTH, b"", is_there=len(data) != bool(self._overflow))
        if len(data) > 1:
            self.context.drop(frame, "SYNC has a counter or nothing")
        else:  # it counts all the same with a byte too many or too few
            self._accept(frame.t_ns, data[0] if data else 0)

    def tick(self) -> None:
        """Produce a SYNC when it is time; late ones keep the grid, missed ones are left out."""
        now_ns = self.context.now_ns
        if now_ns < self.wake_ns:
            return
        self.wake_ns += self._period_ns
        if self.wake_ns <= now_ns:
            self.wake_ns += (now_ns - self.wake_ns) // self._period_ns * self._period_ns + self._period_ns
        self._counter = self._counter % self._overflow + 1 if self._overflow else 0
        self.context.send(self._cob_id, bytes((self._counter,)) if self._overflow else b"")
        self._accept(now_ns, self._counter)

    def _accept(self, t_ns: int, counter: int) -> None:
        """Begin the window of a SYNC that came at ``t_ns``: now, when its frame has no stamp."""
        if self._window_ns:
            self._closes_ns = (t_ns or self.context.now_ns) + self._window_ns
        self.on_sync(counter)

    def skip(self) -> None:
        """Leave out the next SYNC; the grid stays."""
        if self.wake_ns != NEVER:
            self.wake_ns += self._period_ns

    def _plan(self) -> None:
        listening = self.context.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL)
        self.wake_ns = self.context.now_ns + self._period_ns if self._produces and listening else NEVER

    def _changed(self, sub: int) -> None:
        produced = self._produces
        self.configure()
        if self._produces and not produced:
            self._counter = 0
        self.context.listen()

    def _check_cob_id(self, sub: int, data: bytes) -> None:
        """CiA 301, 7.5.2.5: the identifier stays while the SYNC is produced."""
        value, old = int.from_bytes(data, "little"), self.values.number(SYNC_COB_ID, 0)
        is_produced = old & value & COB_ID_PRODUCER
        check_cob_id(value & ~COB_ID_INVALID, old if is_produced else COB_ID_INVALID, COB_ID_PRODUCER)
        if value & COB_ID_PRODUCER and SYNC_PERIOD not in self.values.layout.indices:
            raise SdoAbort(AbortCode.VALUE_INVALID)

    def _check_overflow(self, sub: int, data: bytes) -> None:
        """CiA 301, 7.5.2.22: 0 or 2 to 240, and only while no period runs."""
        if self.values.number(SYNC_PERIOD, 0):
            raise SdoAbort(AbortCode.DEVICE_STATE)
        if data[0] == 1 or data[0] > MAX_COUNTER:
            raise SdoAbort(AbortCode.VALUE_INVALID)
