"""The values of one device: a process image of flat bytes, and a dictionary for what has no fixed size."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.node.layout import OUTSIDE, ImageEntry, ImageLayout, key_of


class Values:
    """Bytes of every entry; without access rights or rules."""

    def __init__(self, layout: ImageLayout) -> None:
        self.layout = layout
        self.image = np.zeros(layout.image_size, np.uint8)
        self.memory = memoryview(self.image.data)
        self.outside: dict[int, bytes | None] = {}

    def load(self, entry: ImageEntry) -> bytes | None:
        """Bytes of an entry; None when it has no value."""
        if entry.offset != OUTSIDE:
            return self.memory[entry.offset : entry.offset + entry.size].tobytes()
        return self.outside[key_of(entry.index, entry.sub)]

    def store(self, entry: ImageEntry, data: bytes | None) -> None:
        """Put the bytes of an entry, whose length is right."""
        if entry.offset != OUTSIDE and data is not None:
            self.memory[entry.offset : entry.offset + entry.size] = data
        else:
            self.outside[key_of(entry.index, entry.sub)] = data

    def default(self, entry: ImageEntry, node_id: int) -> bytes | None:
        """Bytes at power-on for this node-ID."""
        if entry.relative and entry.default is not None:
            value = (int.from_bytes(entry.default, "little") + node_id) % (1 << 8 * entry.size)
            return value.to_bytes(entry.size, "little")
        return entry.default

    def number(self, index: int, sub: int, default: int = 0) -> int:
        """An unsigned integer of the dictionary; ``default`` where the dictionary has no such entry."""
        entry = self.layout.entries.get(key_of(index, sub))
        if entry is None:
            return default
        return int.from_bytes(self.load(entry) or b"", "little")

    def get(self, index: int, sub: int = 0) -> Any:
        """The value as Python has it; KeyError when there is no such entry."""
        entry = self.layout.entries[key_of(index, sub)]
        data = self.load(entry)
        return None if data is None else entry.decode(data)

    def put(self, index: int, sub: int, value: Any) -> None:
        """Set without asking anybody; KeyError or ValueError when it cannot be."""
        entry = self.layout.entries[key_of(index, sub)]
        data = entry.encode(value)
        if entry.size and len(data) != entry.size:
            raise ValueError(f"0x{index:04X}:{sub:02X}: wanted {entry.size} bytes, got {len(data)}")
        self.store(entry, data)

    def view(self, index: int, sub: int, n: int) -> npt.NDArray[Any]:
        """A live view of ``n`` entries from ``sub`` on: what stands there is what PDO and SDO carry.

        One type gives shape (n,); mixed types give one structured element with the dictionary's names.
        """
        offset, dtype = self.layout.span(index, sub, n)
        view = self.image[offset : offset + dtype.itemsize].view(dtype.base)
        return view if dtype.subdtype is not None else view.reshape(())

    def rows(self, index: int, n_objects: int) -> npt.NDArray[Any]:
        """A live structured view (n_objects,) of records of equal layout at consecutive indices."""
        subs = self.layout.subs(index)
        offset, dtype = self.layout.span(index, subs[0], len(subs))
        stride = -(-dtype.itemsize // 8) * 8
        for i in range(n_objects):
            if self.layout.span(index + i, subs[0], len(subs)) != (offset + i * stride, dtype):
                raise ValueError(f"0x{index + i:04X}: its layout differs from 0x{index:04X}")
        return np.ndarray((n_objects,), dtype, self.image, offset, (stride,))
