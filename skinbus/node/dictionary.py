"""The object dictionary as the bus accesses it: access, length, limits and the rules of single objects."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from canopen.objectdictionary import datatypes

from skinbus.node.layout import FLOATS, ImageEntry, key_of
from skinbus.node.values import Values
from skinbus.objects.cia import COB_ID_INVALID, COB_ID_MASK_11, AbortCode, restricted

MAX_LENGTH = 65_536
"""Bytes that a string or domain may have; bounds the memory a client can make us use."""

Rule = Callable[[int, bytes], None]
"""Called with sub-index and bytes before they are stored; raises SdoAbort to refuse."""
Watcher = Callable[[int], None]
"""Called with the sub-index after a value was stored."""
Reader = Callable[[int], bytes]
"""Gives the bytes of a sub-index in place of the store; raises SdoAbort to refuse."""
WriteHook = Callable[[int, int, Any], "AbortCode | None"]
"""The host's word on a write (index, sub-index, value): an abort code refuses it, None lets it pass."""


class SdoAbort(Exception):
    """An access is refused; never leaves the core."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"0x{code:08X}")


def check_cob_id(value: int, old: int, allowed: int = 0) -> None:
    """Refuse the identifier of another service, another one while this one is valid, and bits not allowed."""
    is_wrong = value & ~(COB_ID_INVALID | COB_ID_MASK_11 | allowed)
    if not value & COB_ID_INVALID:
        is_wrong |= not old & COB_ID_INVALID and (old ^ value) & COB_ID_MASK_11
        is_wrong |= restricted(value & COB_ID_MASK_11)
    if is_wrong:
        raise SdoAbort(AbortCode.VALUE_INVALID)


class Dictionary:
    """Reads and writes from the bus, checked; services add rules for their objects."""

    def __init__(self, values: Values) -> None:
        self.values = values
        self.layout = values.layout
        self.rules: dict[int, Rule] = {}
        self.watchers: dict[int, Watcher] = {}
        self.readers: dict[int, Reader] = {}
        self.writers: dict[int, Rule] = {}
        """Objects whose writes are commands: called instead of storing."""
        self.on_write: WriteHook = lambda index, sub, value: None
        self.on_stored: Callable[[ImageEntry], None] = lambda entry: None
        """Called after a write from the bus has changed a value, before the service that lives by it."""

    def find(self, index: int, sub: int) -> ImageEntry:
        """The entry, or the abort that says what is missing."""
        entry = self.layout.entries.get(key_of(index, sub))
        if entry is None:
            raise SdoAbort(AbortCode.NO_SUB_INDEX if index in self.layout.indices else AbortCode.NO_OBJECT)
        return entry

    def read(self, index: int, sub: int) -> bytes:
        """Bytes for an upload."""
        entry = self.find(index, sub)
        if not entry.readable:
            raise SdoAbort(AbortCode.WRITE_ONLY)
        reader = self.readers.get(index)
        if reader is not None:
            return reader(sub)
        data = self.values.load(entry)
        if data is None:
            raise SdoAbort(AbortCode.NO_DATA)
        return data

    def admit(self, index: int, sub: int, length: int | None) -> ImageEntry:
        """The entry if a download of so many bytes (None: not said) may begin."""
        entry = self.find(index, sub)
        if not entry.writable:
            raise SdoAbort(AbortCode.READ_ONLY)
        if length is not None:
            if entry.size and length != entry.size:
                raise SdoAbort(AbortCode.LENGTH_HIGH if length > entry.size else AbortCode.LENGTH_LOW)
            if length > MAX_LENGTH:
                raise SdoAbort(AbortCode.MEMORY)
        return entry

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Take the bytes of a download, or refuse with the reason."""
        entry = self.admit(index, sub, len(data))
        self.check(entry, data)
        rule = self.rules.get(index)
        if rule is not None:
            rule(sub, data)
        self.ask_host(entry, data)
        writer = self.writers.get(index)
        if writer is not None:
            writer(sub, data)
            return
        is_new = data != self.values.load(entry)
        self.values.store(entry, data)
        if is_new:
            self.on_stored(entry)
        self.changed(index, sub)

    def ask_host(self, entry: ImageEntry, data: bytes) -> None:
        """Let the host refuse a write from the bus."""
        code = self.on_write(entry.index, entry.sub, entry.decode(data))
        if code is not None:
            raise SdoAbort(code)

    def changed(self, index: int, sub: int) -> None:
        """Notify the service that uses this object."""
        watcher = self.watchers.get(index)
        if watcher is not None:
            watcher(sub)

    def check(self, entry: ImageEntry, data: bytes) -> None:
        """Refuse values outside the limits of the entry, and booleans and numbers that are none."""
        kind = entry.variable.data_type
        if kind == datatypes.BOOLEAN and data[0] > 1:
            raise SdoAbort(AbortCode.VALUE_INVALID)
        if kind in FLOATS and not math.isfinite(entry.decode(data)):
            raise SdoAbort(AbortCode.VALUE_INVALID)
        low, high = entry.variable.min, entry.variable.max
        if high is not None and entry.decode(data) > high:
            raise SdoAbort(AbortCode.VALUE_HIGH)
        if low is not None and entry.decode(data) < low:
            raise SdoAbort(AbortCode.VALUE_LOW)
