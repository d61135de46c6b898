"""PDO mappings compiled to slices of the process image, and the rules a mapping has to keep."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from canopen.objectdictionary import datatypes

from skinbus.node.dictionary import SdoAbort
from skinbus.node.layout import OUTSIDE, Entry, Layout, key_of
from skinbus.node.values import Values
from skinbus.objects.cia import AbortCode

MAX_BITS: Final = 64
MAX_ENTRIES: Final = 64

# Indices below 0x20 name data types; mapped in an RPDO they skip bytes (CiA 301, 7.4.7.1).
DUMMY_BITS: Final[dict[int, int]] = {
    datatypes.BOOLEAN: 1,
    datatypes.INTEGER8: 8,
    datatypes.INTEGER16: 16,
    datatypes.INTEGER32: 32,
    datatypes.UNSIGNED8: 8,
    datatypes.UNSIGNED16: 16,
    datatypes.UNSIGNED32: 32,
}


@dataclass(frozen=True, slots=True)
class Slot:
    """One mapped object: its entry (None for a dummy), its first bit in the PDO and how many it has."""

    entry: Entry | None
    start: int
    bits: int


@dataclass(frozen=True, slots=True)
class Mapping:
    """The objects of one PDO, in order."""

    slots: tuple[Slot, ...]

    @property
    def n_bits(self) -> int:
        """Bits in use."""
        return self.slots[-1].start + self.slots[-1].bits if self.slots else 0

    @property
    def n_bytes(self) -> int:
        """Bytes on the wire."""
        return -(-self.n_bits // 8)

    @property
    def byte_aligned(self) -> bool:
        """Whether every object is whole bytes."""
        return all(slot.bits % 8 == 0 for slot in self.slots)


def resolve(layout: Layout, value: int, *, transmit: bool) -> tuple[Entry | None, int]:
    """Entry and bits of one mapping value (index, sub-index, length); SdoAbort when it cannot be mapped."""
    index, sub, bits = value >> 16, value >> 8 & 0xFF, value & 0xFF
    if not transmit and index in DUMMY_BITS and sub == 0:
        if bits != DUMMY_BITS[index]:
            raise SdoAbort(AbortCode.NOT_MAPPABLE)
        return None, bits
    entry = layout.entries.get(key_of(index, sub))
    if entry is None:
        raise SdoAbort(AbortCode.NO_OBJECT)
    mappable = entry.mappable_tx if transmit else entry.mappable_rx
    if not mappable or not entry.size or bits != entry.bits:
        raise SdoAbort(AbortCode.NOT_MAPPABLE)
    return entry, bits


def compile_mapping(values: Values, index: int, count: int, *, transmit: bool) -> Mapping:
    """The first ``count`` objects of a mapping record; SdoAbort when they do not make a PDO."""
    if count > MAX_ENTRIES or (count and key_of(index, count) not in values.layout.entries):
        raise SdoAbort(AbortCode.PDO_TOO_LONG)
    slots = []
    start = 0
    for sub in range(1, count + 1):
        entry, bits = resolve(values.layout, values.number(index, sub), transmit=transmit)
        slots.append(Slot(entry, start, bits))
        start += bits
    if start > MAX_BITS:
        raise SdoAbort(AbortCode.PDO_TOO_LONG)
    return Mapping(tuple(slots))


def packer(values: Values, mapping: Mapping) -> Callable[[], bytes]:
    """A function that gives the bytes of a TPDO as the values stand; neighbours are one slice."""
    entries = [slot.entry for slot in mapping.slots if slot.entry is not None]
    if mapping.byte_aligned and all(entry.offset != OUTSIDE for entry in entries):
        views = [values.memory[begin:end] for begin, end in _merge(entries)]
        if len(views) == 1:
            return views[0].tobytes
        return lambda: b"".join(views)
    slots = mapping.slots
    length = mapping.n_bytes

    def pack_bits() -> bytes:
        number = 0
        for slot in slots:
            if slot.entry is not None:
                value = int.from_bytes(values.load(slot.entry) or b"", "little")
                number |= (value & (1 << slot.bits) - 1) << slot.start
        return number.to_bytes(length, "little")

    return pack_bits


def unpack(mapping: Mapping, data: bytes) -> list[tuple[Entry, bytes]]:
    """Entries and bytes of an RPDO that is long enough; dummies are left out."""
    number = int.from_bytes(data[: mapping.n_bytes], "little")
    return [
        (slot.entry, (number >> slot.start & (1 << slot.bits) - 1).to_bytes(slot.entry.size, "little"))
        for slot in mapping.slots
        if slot.entry is not None
    ]


def _merge(entries: list[Entry]) -> list[tuple[int, int]]:
    """Byte ranges of the image, neighbours joined."""
    ranges: list[tuple[int, int]] = []
    for entry in entries:
        begin, end = entry.offset, entry.offset + entry.size
        if ranges and ranges[-1][1] == begin:
            ranges[-1] = (ranges[-1][0], end)
        else:
            ranges.append((begin, end))
    return ranges
