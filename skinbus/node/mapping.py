"""PDO mappings of a running device: the rules they keep, and the slices of the process image behind them."""

from __future__ import annotations

from collections.abc import Callable

from skinbus.node.dictionary import SdoAbort
from skinbus.node.layout import OUTSIDE, ImageEntry, ImageLayout, key_of
from skinbus.node.values import Values
from skinbus.objects.cia import AbortCode
from skinbus.objects.eds_values import TYPES
from skinbus.objects.pdo import PdoMap, split_mapping

MAX_ENTRIES = 64

DUMMIES = range(1, 8)
"""Data types whose index may be mapped in an RPDO to skip their length (CiA 301, 7.4.7.1)."""


def check_entry(layout: ImageLayout, value: int, *, transmit: bool) -> int:
    """Bits of one mapping value; SdoAbort when what it names cannot be mapped."""
    index, sub, bits = split_mapping(value)
    if not transmit and index in DUMMIES and sub == 0:
        if bits != TYPES[index].bits:
            raise SdoAbort(AbortCode.NOT_MAPPABLE)
        return bits
    entry = layout.entries.get(key_of(index, sub))
    if entry is None:
        raise SdoAbort(AbortCode.NO_OBJECT)
    mappable = entry.mappable_tx if transmit else entry.mappable_rx
    if not mappable or not entry.size or bits != entry.bits:
        raise SdoAbort(AbortCode.NOT_MAPPABLE)
    return bits


def check_count(values: Values, mapping: int, count: int, *, transmit: bool) -> None:
    """SdoAbort when the first ``count`` entries of a mapping record do not make a PDO."""
    if count > MAX_ENTRIES or (count and key_of(mapping, count) not in values.layout.entries):
        raise SdoAbort(AbortCode.PDO_TOO_LONG)
    bits = [
        check_entry(values.layout, values.number(mapping, sub), transmit=transmit)
        for sub in range(1, count + 1)
    ]
    if sum(bits) > values.layout.max_pdo_bits:
        raise SdoAbort(AbortCode.PDO_TOO_LONG)


def packer(values: Values, pdo: PdoMap) -> Callable[[], bytes]:
    """A function that gives the bytes of a TPDO as the values stand."""
    slots = [(values.layout.entries[key_of(e.index, e.sub)], e) for e in pdo.entries]
    if all(slot.bits % 8 == 0 and entry.offset != OUTSIDE for entry, slot in slots):
        views = [values.memory[entry.offset : entry.offset + entry.size] for entry, _ in slots]
        views.append(memoryview(bytes(pdo.length - sum(view.nbytes for view in views))))
        return lambda: b"".join(views)

    def pack_bits() -> bytes:
        number = 0
        for entry, slot in slots:
            value = int.from_bytes(values.load(entry) or b"", "little")
            number |= (value & (1 << slot.bits) - 1) << slot.offset
        return number.to_bytes(pdo.length, "little")

    return pack_bits


def unpack(layout: ImageLayout, pdo: PdoMap, data: bytes) -> list[tuple[ImageEntry, bytes]]:
    """Entries and bytes of an RPDO that is long enough; dummies are left out."""
    number = int.from_bytes(data[: pdo.length], "little")
    parts = []
    for slot in pdo.entries:
        if not slot.is_dummy:
            entry = layout.entries[key_of(slot.index, slot.sub)]
            value = number >> slot.offset & (1 << slot.bits) - 1
            parts.append((entry, value.to_bytes(entry.size, "little")))
    return parts
