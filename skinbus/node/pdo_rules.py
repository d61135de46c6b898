"""What CiA 301 allows to be written to the communication and mapping parameters of a PDO, and when."""

from __future__ import annotations

from skinbus.node.context import Context
from skinbus.node.dictionary import SdoAbort, Watcher, check_cob_id
from skinbus.node.layout import key_of
from skinbus.node.mapping import check_count, check_entry
from skinbus.objects.cia import (
    COB_ID_INVALID,
    COB_ID_NO_RTR,
    PDO_COB_ID,
    PDO_INHIBIT,
    PDO_SYNC_START,
    PDO_TYPE,
    AbortCode,
    TransmissionType,
)
from skinbus.objects.pdo import Direction, compile_pdo


class Pdo:
    """One PDO: writes to its two records are checked, and followed by ``changed``."""

    direction: Direction

    def __init__(self, context: Context, number: int, changed: Watcher) -> None:
        self.values, self.number = context.values, number
        self.communication = self.direction.communication + number - 1
        self.mapping = self.direction.mapping + number - 1
        self.transmit = self.direction is Direction.TPDO
        dictionary = context.dictionary
        dictionary.rules |= {
            self.communication: self._check_communication,
            self.mapping: self._check_mapping,
        }
        dictionary.watchers |= dict.fromkeys((self.communication, self.mapping), changed)
        self.compile()

    @property
    def is_on(self) -> bool:
        """Whether the PDO exists (bit 31 of its COB-ID is 0)."""
        return not self.values.number(self.communication, PDO_COB_ID, COB_ID_INVALID) & COB_ID_INVALID

    def compile(self) -> None:
        """Take over the values as they stand; not valid when the mapping is none.

        The rules let no such mapping pass, but a dictionary or a stored value may hold one.
        """
        od, number = self.values.layout.od, self.values.number
        try:
            check_count(self.values, self.mapping, number(self.mapping, 0), transmit=self.transmit)
            self.map = compile_pdo(od, self.direction, self.number, number)
        except SdoAbort:
            self.map = compile_pdo(od, self.direction, self.number, lambda index, sub: 0)
        if not self.map.entries:
            self.map = self.map._replace(valid=False)

    def _check_communication(self, sub: int, data: bytes) -> None:
        """CiA 301, 7.5.2.35 and 7.5.2.37."""
        value = int.from_bytes(data, "little")
        if sub == PDO_COB_ID:
            default = self.values.layout.entries[key_of(self.communication, sub)].default or b""
            # a device of others may allow RTR as delivered
            if self.transmit and int.from_bytes(default, "little") & ~value & COB_ID_NO_RTR:
                raise SdoAbort(AbortCode.VALUE_INVALID)
            old = self.values.number(self.communication, sub, COB_ID_INVALID)
            check_cob_id(value, old, COB_ID_NO_RTR)
        elif sub == PDO_TYPE and TransmissionType.SYNC_MAX < value < TransmissionType.EVENT_MANUFACTURER:
            # 241-251 are reserved; 252 and 253 answer remote frames, which CAN FD and this device do not have
            raise SdoAbort(AbortCode.VALUE_INVALID)
        elif sub in (PDO_INHIBIT, PDO_SYNC_START) and self.is_on:
            raise SdoAbort(AbortCode.ACCESS)

    def _check_mapping(self, sub: int, data: bytes) -> None:
        """CiA 301, 7.5.2.36 and 7.5.2.38: invalid first, then sub-index 0 to 0, the entries, the count."""
        value = int.from_bytes(data, "little")
        if self.is_on:
            raise SdoAbort(AbortCode.ACCESS)
        if sub == 0:
            check_count(self.values, self.mapping, value, transmit=self.transmit)
        elif self.values.number(self.mapping, 0):
            raise SdoAbort(AbortCode.ACCESS)
        elif value:
            check_entry(self.values.layout, value, transmit=self.transmit)
