"""RPDOs into the dictionary: length and deadline watched, all of a PDO or nothing, at once or with SYNC."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.node.context import NS_PER_MS, Context, Handlers, Part
from skinbus.node.dictionary import SdoAbort
from skinbus.node.mapping import unpack
from skinbus.node.nmt import Service
from skinbus.node.pdo_rules import Pdo
from skinbus.objects.cia import EmcyCode, NmtState, TransmissionType
from skinbus.objects.pdo import Direction, pdo_numbers


class Rpdo(Pdo):
    """One RPDO, and where it stands."""

    direction = Direction.RPDO
    waiting: bytes | None = None  # for the next SYNC
    due_ns = NEVER

    @property
    def deadline_ns(self) -> int:
        """Longest time between two of them; 0 when it is not watched."""
        return self.map.event_timer_ms * NS_PER_MS

    @property
    def tag(self) -> bytes:
        """The identifier, as EMCY messages about this PDO carry it."""
        return self.map.cob_id.to_bytes(2, "little")


class RpdoService(Part):
    """All RPDOs of a device."""

    kind = Service.PDO

    def __init__(self, context: Context, in_window: Callable[[], bool]) -> None:
        """``in_window``: whether synchronous RPDOs are taken now (0x1007)."""
        super().__init__(context)
        self.in_window = in_window
        numbers = pdo_numbers(self.dictionary.layout.od, Direction.RPDO)
        self.pdos = {number: Rpdo(context, number, partial(self._changed, number)) for number in numbers}

    def configure(self) -> None:
        """Compile all PDOs from the values, as after a reset."""
        for pdo in self.pdos.values():
            pdo.compile()

    def enter(self, state: NmtState) -> None:
        """Nothing waits, and no deadline runs, until the first PDO after each entry to OPERATIONAL."""
        for pdo in self.pdos.values():
            pdo.waiting = None
            pdo.due_ns = NEVER
        self.wake_ns = NEVER

    def handlers(self) -> Handlers:
        """One handler for each identifier; several PDOs may share it."""
        by_id: dict[int, list[Rpdo]] = {}
        for pdo in self.pdos.values():
            if pdo.map.valid:
                by_id.setdefault(pdo.map.cob_id, []).append(pdo)
        return {can_id: partial(self._receive, pdos) for can_id, pdos in by_id.items()}

    def on_sync(self) -> None:
        """Let the PDOs that waited for SYNC take effect."""
        for pdo in self.pdos.values():
            if pdo.waiting is not None:
                data, pdo.waiting = pdo.waiting, None
                self._apply(pdo, data)

    def tick(self) -> None:
        """Report PDOs whose deadline has passed (CiA 301, 7.5.2.35: the event timer of an RPDO)."""
        self.wake_ns = NEVER
        for pdo in self.pdos.values():
            if self.context.now_ns >= pdo.due_ns:
                pdo.due_ns = NEVER
                self.emcy.raise_error(EmcyCode.RPDO_TIMEOUT, data=pdo.tag)
            self.wake_ns = min(self.wake_ns, pdo.due_ns)

    def _receive(self, pdos: list[Rpdo], frame: Frame) -> None:
        for pdo in pdos:
            surplus = len(frame.data) - pdo.map.length
            self.emcy.report(EmcyCode.PDO_LENGTH, pdo.tag, is_there=surplus < 0)
            if surplus < 0:
                self.context.drop(frame, f"RPDO {pdo.number} has {pdo.map.length} bytes")
                continue
            # the bytes that are mapped count (CiA 301, 7.2.2.2)
            self.emcy.report(EmcyCode.PDO_LENGTH_EXCEEDED, pdo.tag, is_there=surplus > 0)
            if pdo.deadline_ns:
                self.emcy.clear_error(EmcyCode.RPDO_TIMEOUT, pdo.tag)
                pdo.due_ns = self.context.now_ns + pdo.deadline_ns
                self.wake_ns = min(self.wake_ns, pdo.due_ns)
            if pdo.map.transmission_type <= TransmissionType.SYNC_MAX:
                if self.in_window():
                    pdo.waiting = frame.data
                else:
                    self.context.drop(frame, f"RPDO {pdo.number} after the synchronous window")
            else:
                self._apply(pdo, frame.data)

    def _apply(self, pdo: Rpdo, data: bytes) -> None:
        """Store all values, or none if one of them may not be."""
        parts = unpack(self.dictionary.layout, pdo.map, data)
        try:
            for entry, value in parts:
                self.dictionary.check(entry, value)
            for entry, value in parts:
                self.dictionary.ask_host(entry, value)
        except SdoAbort:
            self.context.drop(Frame(pdo.map.cob_id, data), f"RPDO {pdo.number} holds a value out of range")
            return
        for entry, value in parts:
            self.values.store(entry, value)
            self.dictionary.changed(entry.index, entry.sub)

    def _changed(self, number: int, sub: int) -> None:
        pdo = self.pdos[number]
        tag, was_valid = pdo.tag, pdo.map.valid
        pdo.compile()
        pdo.waiting = None
        if not pdo.map.valid or not pdo.deadline_ns:
            pdo.due_ns = NEVER
            self.emcy.clear_error(EmcyCode.RPDO_TIMEOUT, tag)
        if was_valid and not pdo.map.valid:  # nothing will come that could end them
            self.emcy.clear_error(EmcyCode.PDO_LENGTH, tag)
            self.emcy.clear_error(EmcyCode.PDO_LENGTH_EXCEEDED, tag)
        self.context.listen()
