"""The object dictionary compiled once: where every value lives, how long it is and what may be written to it.

Values of fixed size lie in one process image: objects in order of their index, each starting at a multiple
of eight bytes, its sub-indices packed without gaps in little-endian order as on the wire. A PDO that maps
consecutive sub-indices is therefore one slice. Sub-index 0 of arrays and records, strings and domains lie
outside.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import canopen
import numpy as np
from canopen.objectdictionary import ODVariable, datatypes

from skinbus.objects.pdo import frame_bytes

OBJECT_ALIGNMENT = 8
OUTSIDE = -1
"""Offset of a value that is not in the image."""

FIRST_OBJECT = 0x1000
"""Below are data types, which PDOs may map as dummies but nobody can read."""

FLOATS = (datatypes.REAL32, datatypes.REAL64)


def key_of(index: int, sub: int) -> int:
    """The index and sub-index as one number."""
    return index << 8 | sub


class ImageEntry:
    """One value of the dictionary: place, size in bytes (0 = any), access and limits."""

    def __init__(self, variable: Any, base: int) -> None:
        """``variable`` is canopen's ODVariable, which encodes and decodes; ``base`` is its node-ID."""
        self.variable = variable
        self.index, self.sub = variable.index, variable.subindex
        self.size = variable.STRUCT_TYPES[variable.data_type].size if variable.fixed_size else 0
        self.offset = OUTSIDE
        self.relative, default = variable.relative, variable.default
        self.default: bytes | None = bytes(self.size) if self.size else None
        """Bytes at power-on, less the node-ID where the default is relative to it; None without a value."""
        # an integer that is zero need not be encoded, as most are
        if default or (default is not None and (not self.size or variable.data_type in FLOATS)):
            self.default = bytes(variable.encode_raw(default - base if self.relative else default))
        self.readable, self.writable = variable.readable, variable.writable
        access, mappable = variable.access_type, variable.pdo_mappable
        self.mappable_tx = mappable and access not in ("wo", "rww")
        self.mappable_rx = mappable and access in ("wo", "rw", "rww")

    @property
    def bits(self) -> int:
        """Length in a PDO: one bit for a boolean."""
        return 1 if self.variable.data_type == datatypes.BOOLEAN else self.size * 8

    @property
    def numpy_type(self) -> str:
        """The type of an array of such values; opaque for integers of 24 bits and the like."""
        kind = self.variable.data_type
        if self.size not in (1, 2, 4, 8):
            return f"V{self.size}"
        return f"<{'f' if kind in FLOATS else 'i' if kind in datatypes.SIGNED_TYPES else 'u'}{self.size}"

    def decode(self, data: bytes) -> Any:
        """The value as Python has it."""
        return self.variable.decode_raw(data)

    def encode(self, value: Any) -> bytes:
        """The bytes of a value as they stand on the wire; ValueError when it does not fit."""
        return bytes(self.variable.encode_raw(value))


class ImageLayout:
    """All entries of one object dictionary, by index and sub-index."""

    def __init__(self, od: canopen.ObjectDictionary, node_id: int) -> None:
        self.od = od
        self.max_pdo_bits = 8 * frame_bytes(od)
        self.entries: dict[int, ImageEntry] = {}
        self.indices: set[int] = set()
        # $NODEID was resolved for one node; LSS may give the device another one later.
        base = node_id if od.node_id is None else int(od.node_id)
        offset = 0
        for index in sorted(i for i in od if i >= FIRST_OBJECT):
            self.indices.add(index)
            offset = -(-offset // OBJECT_ALIGNMENT) * OBJECT_ALIGNMENT
            for variable, inside in _variables(od[index]):
                entry = ImageEntry(variable, base)
                if inside and entry.size:
                    if entry.size in (2, 4, 8):  # numbers are read and written fastest where they are aligned
                        offset = -(-offset // entry.size) * entry.size
                    entry.offset = offset
                    offset += entry.size
                self.entries[key_of(index, variable.subindex)] = entry
        self.image_size = -(-offset // OBJECT_ALIGNMENT) * OBJECT_ALIGNMENT

    def subs(self, index: int) -> list[int]:
        """Sub-indices of an object but 0, in order; empty when there is no such object."""
        return sorted(key & 0xFF for key in self.entries if key >> 8 == index and key & 0xFF)

    def span(self, index: int, sub: int, n: int) -> tuple[int, np.dtype[Any]]:
        """Offset in the image and dtype of ``n`` entries from ``sub`` on.

        Entries of one type give that type; mixed ones a structured dtype with the dictionary's names.
        """
        entries = [self.entries[key_of(index, sub + i)] for i in range(n)]
        if any(entry.offset == OUTSIDE for entry in entries):
            raise ValueError(f"0x{index:04X}:{sub:02X} + {n}: not in the process image")
        types = [entry.numpy_type for entry in entries]
        if len(set(types)) == 1:
            return entries[0].offset, np.dtype((types[0], (n,)))
        first, last = entries[0].offset, entries[-1]
        fields: Any = {
            "names": [e.variable.name for e in entries],
            "formats": types,
            "offsets": [e.offset - first for e in entries],
            "itemsize": last.offset + last.size - first,
        }
        return first, np.dtype(fields)


def _variables(item: Any) -> Iterator[tuple[Any, bool]]:
    """Variables of one object, and whether they may lie in the image (sub-index 0 of a group does not)."""
    if isinstance(item, ODVariable):
        yield item, True
    else:
        for sub in sorted(item.subindices):
            yield item.subindices[sub], sub != 0
