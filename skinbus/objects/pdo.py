"""PDOs of an object dictionary, compiled: identifier, type, timers, and where each mapped object's bits lie.

Objects are mapped one after another from bit 0 of byte 0, little-endian (CiA 301, 7.4.8); each mapping
entry is index << 16 | sub-index << 8 | length in bits. Indices below 0x20 are dummies: they take room only.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import NamedTuple

from canopen.objectdictionary import ObjectDictionary

from skinbus.can.fd import CLASSIC_BYTES, MAX_BYTES, frame_length
from skinbus.objects import cia
from skinbus.objects.eds_values import TYPES
from skinbus.objects.profile import FRAME_BYTES, current, look_up, number_at

MAX_DUMMY = 0x1F
"""Highest index that stands for a data type, not an object."""

ReadValue = Callable[[int, int], int]
"""Returns the value of a communication or mapping parameter by index and sub-index."""


class Direction(Enum):
    """Seen from the device: it sends TPDOs and receives RPDOs."""

    TPDO = (cia.TPDO_COMMUNICATION, cia.TPDO_MAPPING)
    RPDO = (cia.RPDO_COMMUNICATION, cia.RPDO_MAPPING)

    @property
    def communication(self) -> int:
        """Index of the communication parameter of PDO 1."""
        return self.value[0]

    @property
    def mapping(self) -> int:
        """Index of the mapping parameter of PDO 1."""
        return self.value[1]


class PdoEntry(NamedTuple):
    """One mapped object: bits ``offset`` to ``offset + bits`` of the PDO."""

    index: int  # type: ignore[assignment]  # hides a method of tuples, which is not used here
    sub: int
    offset: int
    bits: int
    signed: bool

    @property
    def is_dummy(self) -> bool:
        """True when the entry only takes room."""
        return self.index <= MAX_DUMMY


class PdoMap(NamedTuple):
    """One PDO, compiled."""

    number: int
    """From 1."""
    cob_id: int
    """Identifier alone, without the flags of the parameter."""
    valid: bool
    extended: bool
    transmission_type: int
    inhibit_100us: int
    event_timer_ms: int
    sync_start: int
    entries: tuple[PdoEntry, ...]
    length: int
    """Bytes of a frame; beyond 8 there are only the lengths of CAN FD."""


def frame_bytes(od: ObjectDictionary) -> int:
    """Return the most bytes that a PDO of the device may have: more than 8 if it is one for CAN FD."""
    try:
        return min(max(int(current(look_up(od, FRAME_BYTES)) or 0), CLASSIC_BYTES), MAX_BYTES)
    except KeyError:
        return CLASSIC_BYTES


def split_mapping(entry: int) -> tuple[int, int, int]:
    """Return index, sub-index and length in bits of a mapping entry."""
    return entry >> 16, (entry >> 8) & 0xFF, entry & 0xFF


def compile_pdo(
    od: ObjectDictionary, direction: Direction, number: int, read: ReadValue | None = None
) -> PdoMap:
    """Return one PDO; ``read`` gives the parameters as they are now, else the file's values count.

    Raises:
        KeyError: the dictionary has no such PDO.
    """
    read = read or partial(number_at, od)
    communication, mapping = direction.communication + number - 1, direction.mapping + number - 1
    parameters = od.indices[communication]

    def parameter(sub: int) -> int:
        return read(communication, sub) if sub in parameters.subindices else 0

    cob_id = parameter(cia.PDO_COB_ID)
    extended = bool(cob_id & cia.COB_ID_EXTENDED)
    entries = _compile_entries(od, mapping, read)
    return PdoMap(
        number=number,
        cob_id=cob_id & (cia.COB_ID_MASK_29 if extended else cia.COB_ID_MASK_11),
        valid=not cob_id & cia.COB_ID_INVALID,
        extended=extended,
        transmission_type=parameter(cia.PDO_TYPE),
        inhibit_100us=parameter(cia.PDO_INHIBIT),
        event_timer_ms=parameter(cia.PDO_EVENT_TIMER),
        sync_start=parameter(cia.PDO_SYNC_START),
        entries=entries,
        length=frame_length((sum(entry.bits for entry in entries) + 7) // 8),
    )


def pdo_numbers(od: ObjectDictionary, direction: Direction) -> list[int]:
    """Return the numbers of the PDOs that a dictionary has, valid or not."""
    first = direction.communication
    return [index - first + 1 for index in sorted(od.indices) if first <= index < first + cia.MAX_PDOS]


def tpdos(od: ObjectDictionary) -> list[PdoMap]:
    """Return all TPDOs of a dictionary in the order of their numbers."""
    return [compile_pdo(od, Direction.TPDO, n) for n in pdo_numbers(od, Direction.TPDO)]


def readings_in(pdo: PdoMap) -> list[PdoEntry]:
    """Return the readings that a PDO maps."""
    return [entry for entry in pdo.entries if entry.index in cia.READINGS and entry.sub > 0]


def carries_readings(pdo: PdoMap) -> bool:
    """Return whether readings are taken from a PDO: it is valid, of 11 bits, and maps some."""
    return pdo.valid and not pdo.extended and bool(readings_in(pdo))


def _compile_entries(od: ObjectDictionary, mapping: int, read: ReadValue) -> tuple[PdoEntry, ...]:
    if mapping not in od.indices:
        return ()
    entries = []
    offset = 0
    for sub in range(1, read(mapping, 0) + 1):
        index, sub_index, bits = split_mapping(read(mapping, sub))
        variable = od.get_variable(index, sub_index)
        data_type = index if index <= MAX_DUMMY or variable is None else variable.data_type
        signed = data_type in TYPES and TYPES[data_type].low < 0
        entries.append(PdoEntry(index, sub_index, offset, bits, signed))
        offset += bits
    return tuple(entries)
