"""RPDOs into the dictionary: length and deadline watched, all of a PDO or nothing, at once or with SYNC."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from skinbus.bus.core import NEVER
from skinbus.bus.frame import Frame
from skinbus.node.context import NS_PER_MS, Context, Handler
from skinbus.node.dictionary import Dictionary, SdoAbort
from skinbus.node.emcy import EmcyService
from skinbus.node.mapping import Mapping, compile_mapping, unpack
from skinbus.node.nmt import Service
from skinbus.node.pdo_rules import PdoRules
from skinbus.objects.cia import (
    COB_ID_MASK_11,
    MAX_PDOS,
    PDO_COB_ID,
    PDO_EVENT_TIMER,
    PDO_TYPE,
    RPDO_COMMUNICATION,
    RPDO_MAPPING,
    EmcyCode,
    NmtState,
    TransmissionType,
)


@dataclass(slots=True)
class Rpdo:
    """One RPDO, compiled from its two records, and where it stands."""

    number: int
    rules: PdoRules
    active: bool = False
    cob_id: int = 0
    synchronous: bool = False
    deadline_ns: int = 0
    mapping: Mapping = field(default_factory=lambda: Mapping(()))
    waiting: bytes | None = None  # for the next SYNC
    due_ns: int = NEVER

    @property
    def tag(self) -> bytes:
        """The identifier, as EMCY messages about this PDO carry it."""
        return self.cob_id.to_bytes(2, "little")


class RpdoService:
    """All RPDOs of a device."""

    kind = Service.PDO

    def __init__(self, context: Context, dictionary: Dictionary, emcy: EmcyService) -> None:
        self.context = context
        self.dictionary = dictionary
        self.emcy = emcy
        self.wake_ns = NEVER
        self.pdos: list[Rpdo] = []
        self.on_change: Callable[[], None] = lambda: None
        """Called when an identifier may have changed."""
        indices = dictionary.layout.indices
        for number in range(1, MAX_PDOS + 1):
            communication, mapping = RPDO_COMMUNICATION + number - 1, RPDO_MAPPING + number - 1
            if communication not in indices or mapping not in indices:
                continue
            rules = PdoRules(context.values, communication, mapping, transmit=False)
            pdo = Rpdo(number, rules)
            self.pdos.append(pdo)
            dictionary.rules[communication] = rules.check_communication
            dictionary.rules[mapping] = rules.check_mapping
            dictionary.watchers[communication] = partial(self._changed, pdo)
            dictionary.watchers[mapping] = partial(self._changed, pdo)

    def configure(self) -> None:
        """Compile all PDOs from the values, as after a reset."""
        for pdo in self.pdos:
            self._compile(pdo)

    def enter(self, state: NmtState) -> None:
        """Nothing waits, and no deadline runs, until the first PDO after each entry to OPERATIONAL."""
        for pdo in self.pdos:
            pdo.waiting = None
            pdo.due_ns = NEVER
        self.wake_ns = NEVER

    def handlers(self) -> dict[int, Handler]:
        """One handler for each identifier; several PDOs may share it."""
        by_id: dict[int, list[Rpdo]] = {}
        for pdo in self.pdos:
            if pdo.active:
                by_id.setdefault(pdo.cob_id, []).append(pdo)
        return {can_id: partial(self._receive, pdos) for can_id, pdos in by_id.items()}

    def on_sync(self) -> None:
        """Let the PDOs that waited for SYNC take effect."""
        for pdo in self.pdos:
            if pdo.waiting is not None:
                data, pdo.waiting = pdo.waiting, None
                self._apply(pdo, data)

    def tick(self) -> None:
        """Report PDOs whose deadline has passed (CiA 301, 7.5.2.35: the event timer of an RPDO)."""
        self.wake_ns = NEVER
        for pdo in self.pdos:
            if self.context.now_ns >= pdo.due_ns:
                pdo.due_ns = NEVER
                self.emcy.raise_error(EmcyCode.RPDO_TIMEOUT, data=pdo.tag)
            self.wake_ns = min(self.wake_ns, pdo.due_ns)

    def _receive(self, pdos: list[Rpdo], frame: Frame) -> None:
        for pdo in pdos:
            surplus = len(frame.data) - pdo.mapping.n_bytes
            if surplus < 0:
                self.emcy.raise_error(EmcyCode.PDO_LENGTH, data=pdo.tag)
                self.context.drop(frame, f"RPDO {pdo.number} has {pdo.mapping.n_bytes} bytes")
                continue
            self.emcy.clear_error(EmcyCode.PDO_LENGTH, pdo.tag)
            if surplus > 0:  # the bytes that are mapped count (CiA 301, 7.2.2.2)
                self.emcy.raise_error(EmcyCode.PDO_LENGTH_EXCEEDED, data=pdo.tag)
            else:
                self.emcy.clear_error(EmcyCode.PDO_LENGTH_EXCEEDED, pdo.tag)
            if pdo.deadline_ns:
                self.emcy.clear_error(EmcyCode.RPDO_TIMEOUT, pdo.tag)
                pdo.due_ns = self.context.now_ns + pdo.deadline_ns
                self.wake_ns = min(self.wake_ns, pdo.due_ns)
            if pdo.synchronous:
                pdo.waiting = frame.data
            else:
                self._apply(pdo, frame.data)

    def _apply(self, pdo: Rpdo, data: bytes) -> None:
        """Store all values, or none if one of them may not be."""
        parts = unpack(pdo.mapping, data)
        try:
            for entry, value in parts:
                self.dictionary.check(entry, value)
            for entry, value in parts:
                self.dictionary.ask_host(entry, value)
        except SdoAbort:
            self.context.drop(Frame(pdo.cob_id, data), f"RPDO {pdo.number} holds a value out of range")
            return
        for entry, value in parts:
            self.context.values.store(entry, value)
            self.dictionary.changed(entry.index, entry.sub)

    def _changed(self, pdo: Rpdo, sub: int) -> None:
        self._compile(pdo)
        pdo.waiting = None
        if not pdo.active or not pdo.deadline_ns:
            pdo.due_ns = NEVER
        self.on_change()

    def _compile(self, pdo: Rpdo) -> None:
        number, communication = self.context.values.number, pdo.rules.communication
        pdo.cob_id = number(communication, PDO_COB_ID) & COB_ID_MASK_11
        pdo.synchronous = number(communication, PDO_TYPE, 255) <= TransmissionType.SYNC_MAX
        pdo.deadline_ns = number(communication, PDO_EVENT_TIMER) * NS_PER_MS
        try:
            count = number(pdo.rules.mapping, 0)
            pdo.mapping = compile_mapping(self.context.values, pdo.rules.mapping, count, transmit=False)
        except SdoAbort:  # a dictionary or a stored value that the rules would have refused
            pdo.mapping = Mapping(())
        pdo.active = pdo.rules.valid and bool(pdo.mapping.slots)
