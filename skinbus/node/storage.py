"""Store and restore parameters (0x1010, 0x1011) through a storage that the host gives.

What is stored is text: one line for each parameter that differs from its default, under a head that names the
device it belongs to and over a checksum. What does not fit is not loaded, and is reported.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, MutableMapping
from functools import partial

from skinbus.can.event import EventKind
from skinbus.node.context import Context, Part
from skinbus.node.dictionary import SdoAbort
from skinbus.node.layout import ImageEntry, key_of
from skinbus.objects.cia import (
    ERROR_HISTORY,
    IDENTITY,
    IDENTITY_PRODUCT,
    IDENTITY_VENDOR,
    PROGRAM_CONTROL,
    REQUEST_NMT,
    RESTORE_DEFAULTS,
    SIGNATURE_LOAD,
    SIGNATURE_SAVE,
    STORE_ALL,
    STORE_APPLICATION,
    STORE_COMMUNICATION,
    STORE_MANUFACTURER,
    STORE_PARAMETERS,
    VERIFY_CONFIGURATION,
    VERIFY_DATE,
    VERIFY_TIME,
    AbortCode,
)
from skinbus.objects.profile import GUARD_LIMITS

COMMUNICATION = "communication"
APPLICATION = "application"
MANUFACTURER = "manufacturer"
LSS = "lss"

# CiA 301, 7.4.1: the areas of the dictionary.
AREAS: dict[str, range] = {
    COMMUNICATION: range(0x1000, 0x2000),
    MANUFACTURER: range(0x2000, 0x6000),
    APPLICATION: range(0x6000, 0xA000),
}
GROUPS: dict[int, tuple[str, ...]] = {
    STORE_ALL: tuple(AREAS),
    STORE_COMMUNICATION: (COMMUNICATION,),
    STORE_APPLICATION: (APPLICATION,),
    STORE_MANUFACTURER: (MANUFACTURER,),
}
SAVES_ON_COMMAND = 1
"""Value read from 0x1010 and 0x1011 (CiA 301, 7.5.2.13): on command, not by itself."""

# Writable, but an action or a state, not a parameter.
NOT_PARAMETERS = frozenset({ERROR_HISTORY, STORE_PARAMETERS, RESTORE_DEFAULTS, PROGRAM_CONTROL, REQUEST_NMT})

HEAD = "skinbus parameters 1"

Act = Callable[[str], object]
"""On a group of parameters."""


def is_parameter(entry: ImageEntry) -> bool:
    """Whether an entry is one that can be kept; limits of the guard never are: they must be of today."""
    is_state = entry.index in NOT_PARAMETERS or entry.variable.name == GUARD_LIMITS
    return entry.writable and entry.readable and not is_state


Storage = MutableMapping[str, str]
"""Where a device keeps the text of each group over a power cycle; OSError where it cannot."""


class StorageService(Part):
    """Serves 0x1010 and 0x1011, and gives a reset the values that were stored."""

    def __init__(self, context: Context, storage: Storage | None) -> None:
        super().__init__(context)
        self.storage = storage
        dictionary = self.dictionary
        for index in (STORE_PARAMETERS, RESTORE_DEFAULTS):
            dictionary.readers[index] = partial(self._capability, index)
        dictionary.writers[STORE_PARAMETERS] = self._store
        dictionary.writers[RESTORE_DEFAULTS] = self._restore

    def load(self, group: str) -> bool:
        """Put the stored values of a group in place; False when what is stored is damaged or not ours."""
        lines = self.kept(group)
        if not lines:
            return lines is not None
        if lines[0] != self._head():
            self.context.report(EventKind.STORAGE, f"{group}: stored by another device: {lines[0]}")
            return False
        refused = [line for line in lines[1:] if not self._load_line(group, line)]
        if refused:
            self.context.report(EventKind.STORAGE, f"{group}: not loaded: {'; '.join(refused)}")
        return not refused

    def save(self, group: str) -> None:
        """Keep all parameters of a group that differ from their defaults."""
        lines = [self._head()]
        for entry in self.dictionary.layout.entries.values():
            if entry.index in AREAS[group] and is_parameter(entry):
                data = self.values.load(entry)
                if data is not None and data != self.values.default(entry, self.context.node_id):
                    lines.append(f"{entry.index:04X}:{entry.sub:02X} {data.hex()}")
        self.keep(group, "\n".join(lines))

    def kept(self, group: str) -> list[str] | None:
        """Return the lines that are kept of a group, none where there are none; None if they are damaged."""
        try:
            text = None if self.storage is None else self.storage.get(group)
            return [] if text is None else _unseal(text)
        except (OSError, ValueError) as error:
            self.context.report(EventKind.STORAGE, f"{group}: {error}")
            return None

    def keep(self, group: str, text: str) -> None:
        """Keep lines; OSError where they cannot be kept."""
        if self.storage is None:
            raise OSError("no storage")
        self.storage[group] = f"{text}\n{zlib.crc32(text.encode()):08x}\n"

    def _head(self) -> str:
        number = self.values.number
        return f"{HEAD} {number(IDENTITY, IDENTITY_VENDOR):08X} {number(IDENTITY, IDENTITY_PRODUCT):08X}"

    def _forget_marks(self) -> None:
        """Take 0x1020 out of what is stored: with other parameters beside it, it would be wrong."""
        lines = self.kept(COMMUNICATION) or []
        left = [line for line in lines if not line.startswith(f"{VERIFY_CONFIGURATION:04X}:")]
        if left != lines:
            self.keep(COMMUNICATION, "\n".join(left))

    def _load_line(self, group: str, line: str) -> bool:
        """Store one parameter if the dictionary of today would take it."""
        try:
            place, _, digits = line.partition(" ")
            index, _, sub = place.partition(":")
            entry = self.dictionary.layout.entries[key_of(int(index, 16), int(sub, 16))]
            data = bytes.fromhex(digits)
            self.dictionary.admit(entry.index, entry.sub, len(data))
            self.dictionary.check(entry, data)
        except (KeyError, ValueError, SdoAbort):
            return False
        if entry.index not in AREAS[group]:
            return False
        self.values.store(entry, data)
        return True

    def _capability(self, index: int, sub: int) -> bytes:
        if sub == 0:
            return self.values.number(index, 0).to_bytes(1, "little")
        return (SAVES_ON_COMMAND if self.storage is not None else 0).to_bytes(4, "little")

    def _store(self, sub: int, data: bytes) -> None:
        marks = [self.values.number(VERIFY_CONFIGURATION, mark) for mark in (VERIFY_DATE, VERIFY_TIME)]
        self._command(sub, data, SIGNATURE_SAVE, self.save, is_marked=any(marks))

    def _restore(self, sub: int, data: bytes) -> None:
        """Discard what is stored; the defaults are valid after the next reset (CiA 301, 7.5.2.14)."""
        self._command(sub, data, SIGNATURE_LOAD, self.discard)

    def discard(self, group: str) -> None:
        """Keep nothing of a group."""
        if self.storage is not None:
            self.storage.pop(group, None)

    def _command(self, sub: int, data: bytes, signature: int, act: Act, *, is_marked: bool = False) -> None:
        """Do what a signature asks for; ``is_marked``: with the present values 0x1020 is right."""
        if int.from_bytes(data, "little") != signature:
            raise SdoAbort(AbortCode.NOT_STORED)
        if self.storage is None:
            raise SdoAbort(AbortCode.LOCAL_CONTROL)
        groups = GROUPS.get(sub, ())
        for group in groups:
            act(group)
        if groups and COMMUNICATION not in groups and not is_marked:
            self._forget_marks()


def _unseal(text: str) -> list[str]:
    """The lines above the checksum; ValueError when it is wrong."""
    body, _, checksum = text.rstrip("\n").rpartition("\n")
    if not body or checksum != f"{zlib.crc32(body.encode()):08x}":
        raise ValueError("damaged: the checksum is wrong")
    return body.split("\n")
