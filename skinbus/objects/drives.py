"""Drives on the bus: where the position of a joint is in the TPDOs of its drive (CiA 402-2, 0x6064).

Only what the EDS or DCF maps is read; drives are commanded by their own master, never by this one.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from canopen.objectdictionary import ObjectDictionary

from skinbus.objects import cia
from skinbus.objects.pdo import PdoEntry, PdoMap, tpdos

POSITION_ACTUAL_VALUE: Final = 0x6064
"""In increments (CiA 402-2)."""


class DrivePosition(NamedTuple):
    """A position in a TPDO: bits ``offset`` to ``offset + bits`` of a frame of ``length`` bytes."""

    cob_id: int
    length: int
    offset: int
    bits: int
    signed: bool
    is_synchronous: bool
    """Whether it is the position at the SYNC; else at the time of the frame."""

    def counts(self, data: bytes) -> int | None:
        """Return the counts in a frame, None if its length is wrong."""
        if len(data) != self.length:
            return None
        value = int.from_bytes(data, "little") >> self.offset & (1 << self.bits) - 1
        return value - (1 << self.bits) if self.signed and value >> (self.bits - 1) else value

    def frame_of(self, counts: int) -> bytes:
        """Return a frame with these counts, all else 0; what has too few bits wraps, as counters do."""
        return ((counts & (1 << self.bits) - 1) << self.offset).to_bytes(self.length, "little")


def drive_position(od: ObjectDictionary) -> DrivePosition | None:
    """Return where a drive sends its position; None if no valid TPDO of 11 bits maps it."""
    found = [(pdo, entry) for pdo in tpdos(od) for entry in pdo.entries if _is_position(pdo, entry)]
    if not found:
        return None
    pdo, entry = found[0]
    synchronous = pdo.transmission_type <= cia.TransmissionType.SYNC_MAX
    return DrivePosition(pdo.cob_id, pdo.length, entry.offset, entry.bits, entry.signed, synchronous)


def _is_position(pdo: PdoMap, entry: PdoEntry) -> bool:
    return pdo.valid and not pdo.extended and (entry.index, entry.sub) == (POSITION_ACTUAL_VALUE, 0)
