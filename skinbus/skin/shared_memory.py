"""Cycles in POSIX shared memory: one process writes, others read without waiting for it.

Layout, version 2; little-endian, aligned by their size; see ``docs/shared-memory.md``::

    header   HEADER                     what does not change, and the number of the newest cycle
    names    32 bytes each              UTF-8, padded with zeros: the links, then the buses
    patches  MEMBER each                node-ID, bus, link
    slots    SLOTS times                cycle n is in slot n % SLOTS
        CYCLE, PATCH each, pressures (n_tactels,) f32, valid (n_tactels,) u8, faults (n_tactels,) u8,
        padding to 8, budget (us) f64, CONTACT each

A slot is under a sequence lock: ``sequence`` is 2n - 1 while cycle n is written and 2n when it is whole. The
writer goes round all slots, so a reader has SLOTS - 1 cycles to copy one and is never held up; what it has
copied is whole if the sequence was 2n before and after. A writer that ends in the middle of a cycle leaves
the one before it as the newest.

The writer holds a lock of its open file on the object: the kernel releases it when the process ends, however
it ends. ``state`` shows that it was stopped; the age of the newest cycle shows that it hangs.

Memory order: the stores of the sequence, of the data and of ``newest`` must be seen in their order. On x86
they are; elsewhere a full barrier stands between them: a lock released and taken again.
"""

from __future__ import annotations

import math
import mmap
import os
import platform
import struct
import threading
from contextlib import closing, suppress
from typing import Any, Final

import numpy as np

from skinbus.errors import ShareError
from skinbus.estimate import LEVELS
from skinbus.skin.cycle import CONTACT, PATCH, UNKNOWN_LEVEL, Cycle, Records, SkinLayout
from skinbus.skin.shared_object import create, is_locked, path_of

MAGIC: Final = int.from_bytes(b"SKINBUS1", "little")
VERSION: Final = 2
SLOTS: Final = 16
"""A reader that is held up for less than 15 cycles, 0.3 s at 50 Hz, needs one try."""
MAX_CONTACTS: Final = 64
"""As many as the tracker keeps."""
NAME_BYTES: Final = 32
CONTACT_BYTES: Final = CONTACT.itemsize
RUNNING, STOPPED = 1, 2

HEADER: Final = np.dtype(
    [
        ("magic", "<u8"),
        ("version", "<u4"),
        ("state", "<u4"),
        ("newest", "<u8"),
        ("period_ns", "<u8"),
        ("n_slots", "<u4"),
        ("slot_bytes", "<u4"),
        ("first_slot", "<u4"),
        ("contacts_offset", "<u4"),
        ("n_links", "<u4"),
        ("n_buses", "<u4"),
        ("n_patches", "<u4"),
        ("n_tactels", "<u4"),
        ("name", "S64"),
        ("geometry", "<u8", (3,)),
    ]
)
"""152 bytes at the beginning."""

MEMBER: Final = np.dtype([("node_id", "<u4"), ("bus", "<u4"), ("link", "<u4"), ("n_tactels", "<u4")])

CYCLE: Final = np.dtype(
    [
        ("sequence", "<u8"),
        ("number", "<u8"),
        ("t_ns", "<i8"),
        ("latency_ns", "<i8"),
        ("counter", "<u4"),
        ("level", "<u4"),
        ("flags", "<u4"),
        ("n_contacts", "<u4"),
    ]
)
"""48 bytes at the beginning of a slot."""

BUDGET: Final = struct.Struct("<d")
"""Before the contacts of a slot: most time of the estimator, us; NaN where it is not known."""
HEAD: Final = struct.Struct("<QQqqIIII")
"""The same for a reader: one call in place of eight fields."""

NEWEST: Final = 2
STATE_WORD: Final = 3
N_CONTACTS_WORD: Final = 11
"""Places: ``newest`` of the header in words of 8 bytes, ``state`` and, in a slot, ``n_contacts`` of 4."""

IS_ORDERED: Final = platform.machine() == "x86_64"
"""Whether loads and stores keep their order without a barrier."""


def is_written(name: str) -> bool:
    """Whether a process writes under a name now; ShareError for memory of another version."""
    try:
        with closing(SharedReader(name)) as reader:
            return reader.is_alive and not reader.is_stopped
    except ShareError as error:
        if not isinstance(error.__cause__, FileNotFoundError):  # as when one is just being replaced
            raise
    return False


class Offsets:
    """Where things are in a slot of an arm."""

    def __init__(self, n_patches: int, n_tactels: int) -> None:
        self.patches = CYCLE.itemsize
        self.pressures = self.patches + n_patches * PATCH.itemsize
        self.valid = self.pressures + 4 * n_tactels
        self.faults = self.valid + n_tactels
        self.budget = _aligned(self.faults + n_tactels)
        self.contacts = self.budget + 8
        self.slot_bytes = self.contacts + MAX_CONTACTS * CONTACT.itemsize


def barrier() -> None:
    """Let no load or store pass, either way: a lock that is released and taken again does that."""
    if IS_ORDERED:
        return
    lock = threading.Lock()
    lock.acquire()
    lock.release()
    lock.acquire()


def pack_cycle(cycle: Cycle, number: int, offsets: Offsets) -> bytes:
    """Return a cycle as the bytes of a slot, as far as it has contacts."""
    records, readings = cycle.records[:MAX_CONTACTS], cycle.readings
    head = np.zeros((), CYCLE)
    head["sequence"], head["number"], head["t_ns"] = 2 * number, number, cycle.t_ns
    head["latency_ns"] = round(1e9 * cycle.latency_s)
    head["counter"], head["flags"] = cycle.counter, int(cycle.flags)
    head["level"] = LEVELS.index(cycle.level) if cycle.level else UNKNOWN_LEVEL
    head["n_contacts"] = len(records)
    parts = (
        head.tobytes(),
        cycle.patch_records.tobytes(),
        readings.pressures.astype("<f4").tobytes(),
        readings.valid.tobytes(),
        readings.faults.tobytes(),
    )
    budget_us = math.nan if cycle.budget_us is None else cycle.budget_us
    return b"".join(parts).ljust(offsets.budget, b"\0") + BUDGET.pack(budget_us) + records.tobytes()


class SharedWriter:
    """Writes cycles; one at a time under a name."""

    def __init__(self, name: str, layout: SkinLayout) -> None:
        """Make the object.

        Raises:
            ShareError: another process writes under this name, or the object cannot be made.
        """
        self._path = path_of(name)
        self._offsets = offsets = Offsets(len(layout.node_id), layout.n_tactels)
        members = np.zeros(len(layout.node_id), MEMBER)
        members["node_id"], members["bus"], members["link"] = (
            layout.node_id,
            layout.patch_bus,
            layout.patch_link,
        )
        if layout.patch_tactels is not None:
            members["n_tactels"] = layout.patch_tactels
        names = b"".join(_fixed(text) for text in (*layout.links, *layout.buses))
        header = np.zeros((), HEADER)
        first_slot = _aligned(HEADER.itemsize + len(names) + members.nbytes)
        for field, value in {
            "magic": MAGIC,
            "version": VERSION,
            "state": RUNNING,
            "period_ns": layout.period_ns,
            "n_slots": SLOTS,
            "slot_bytes": offsets.slot_bytes,
            "first_slot": first_slot,
            "contacts_offset": offsets.contacts,
            "n_links": len(layout.links),
            "n_buses": len(layout.buses),
            "n_patches": len(layout.node_id),
            "n_tactels": layout.n_tactels,
            "name": layout.name.encode()[:63],
            "geometry": layout.geometry,
        }.items():
            header[field] = value
        begin = header.tobytes() + names + members.tobytes()
        self._file = create(self._path, begin, first_slot + SLOTS * offsets.slot_bytes)
        self._map = mmap.mmap(self._file, 0)
        self._bytes = memoryview(self._map)
        self._words = self._bytes.cast("Q")
        self._halves = self._bytes.cast("I")
        self._first_slot = first_slot
        self._number = 0

    def write(self, cycle: Cycle) -> None:
        """Write a cycle; readers see it whole or not at all."""
        self._number += 1
        n, offsets = self._number, self._offsets
        data = pack_cycle(cycle, n, offsets)[8:]
        start = self._first_slot + n % SLOTS * offsets.slot_bytes
        self._words[start // 8] = 2 * n - 1
        barrier()
        self._bytes[start + 8 : start + 8 + len(data)] = data
        barrier()
        self._words[start // 8] = 2 * n
        barrier()
        self._words[NEWEST] = n

    def close(self) -> None:
        """Say that it is over and remove the name; readers keep what they have."""
        if self._file < 0:
            return
        self._halves[STATE_WORD] = STOPPED
        with suppress(FileNotFoundError):
            if self._path.stat().st_ino == os.fstat(self._file).st_ino:
                self._path.unlink()
        for view in (self._words, self._halves, self._bytes):
            view.release()
        self._map.close()
        os.close(self._file)
        self._file = -1


class SharedReader:
    """Reads cycles that another process writes."""

    def __init__(self, name: str) -> None:
        """Map the object.

        Raises:
            ShareError: there is none, it cannot be read, or it has another layout.
        """
        path = path_of(name)
        try:
            self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError as error:
            wanted = f"does `skinbus run --share {name}` run?" if error.errno == 2 else error.strerror
            raise ShareError(f"no shared memory {name!r}: {wanted}") from error
        try:
            self._map = mmap.mmap(self._file, 0, mmap.MAP_SHARED | mmap.MAP_POPULATE, mmap.PROT_READ)
            self.layout = self._read_layout(name)
        except (ShareError, ValueError) as error:
            os.close(self._file)
            raise ShareError(f"shared memory {name!r} is not of this version of skinbus") from error
        self._bytes = memoryview(self._map)
        self._words = self._bytes.cast("Q")
        self._halves = self._bytes.cast("I")
        self.offsets = offsets = Offsets(len(self.layout.node_id), self.layout.n_tactels)
        self._slot_bytes, self._contacts = offsets.slot_bytes, offsets.contacts

    @property
    def newest(self) -> int:
        """Number of the newest cycle; 0 when there is none yet."""
        return self._words[NEWEST]

    @property
    def is_stopped(self) -> bool:
        """Whether the writer was stopped."""
        return self._halves[STATE_WORD] != RUNNING

    @property
    def is_alive(self) -> bool:
        """Whether the process that writes is there: whether its lock is held."""
        return is_locked(self._file)

    def read(self, number: int) -> bytes | None:
        """Return a copy of the slot of a cycle; None when it is there no more. It is whole."""
        words = self._words
        start = self._first_slot + number % SLOTS * self._slot_bytes
        at = start // 8
        if words[at] != 2 * number:
            return None
        if not IS_ORDERED:
            barrier()
        n_contacts = min(self._halves[start // 4 + N_CONTACTS_WORD], MAX_CONTACTS)
        copy = self._map[start : start + self._contacts + n_contacts * CONTACT_BYTES]
        if not IS_ORDERED:
            barrier()
        return copy if words[at] == 2 * number else None

    def read_newest(self) -> tuple[int, bytes]:
        """Return the number of the newest cycle and a copy of its slot; 0 when there is none yet."""
        while number := self._words[NEWEST]:
            if (data := self.read(number)) is not None:
                return number, data
        return 0, b""

    def close(self) -> None:
        """Let go of it; a second call does nothing."""
        if self._file < 0:
            return
        for view in (self._words, self._halves, self._bytes):
            view.release()
        self._map.close()
        os.close(self._file)
        self._file = -1

    def _read_layout(self, name: str) -> SkinLayout:
        """Return what does not change; ShareError when it is not of this version."""
        header: Any = np.frombuffer(self._map, HEADER, 1)[0]
        if int(header["magic"]) != MAGIC or int(header["version"]) != VERSION:
            raise ShareError(name)
        counts = [int(header[key]) for key in ("n_links", "n_buses", "n_patches", "n_tactels")]
        n_links, n_buses, n_patches, n_tactels = counts
        offsets = Offsets(n_patches, n_tactels)
        self._first_slot = int(header["first_slot"])
        n_bytes = self._first_slot + int(header["n_slots"]) * offsets.slot_bytes
        if int(header["slot_bytes"]) != offsets.slot_bytes or len(self._map) < n_bytes:
            raise ShareError(name)
        begin = HEADER.itemsize
        names = [
            self._map[begin + NAME_BYTES * k : begin + NAME_BYTES * (k + 1)].rstrip(b"\0").decode()
            for k in range(n_links + n_buses)
        ]
        members: Records = np.frombuffer(
            self._map[:], MEMBER, n_patches, begin + NAME_BYTES * (n_links + n_buses)
        )
        return SkinLayout(
            bytes(header["name"]).decode(errors="replace"),
            tuple(names[:n_links]),
            tuple(names[n_links:]),
            members["node_id"].astype(np.int32),
            members["bus"].astype(np.int32),
            members["link"].astype(np.int32),
            n_tactels,
            int(header["period_ns"]),
            geometry=tuple(header["geometry"].tolist()),
            patch_tactels=members["n_tactels"].astype(np.int32) if members["n_tactels"].all() else None,
        )


def _aligned(n: int) -> int:
    return -(-n // 8) * 8


def _fixed(text: str) -> bytes:
    """Return a name in its place; what is too long is cut between two characters."""
    return text.encode()[: NAME_BYTES - 1].decode(errors="ignore").encode().ljust(NAME_BYTES, b"\0")
