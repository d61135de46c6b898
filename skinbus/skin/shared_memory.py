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

import fcntl
import grp
import math
import mmap
import os
import platform
import pwd
import re
import stat
import struct
import threading
from contextlib import closing, suppress
from pathlib import Path
from typing import Final

import numpy as np

from skinbus.errors import ArgumentError, ShareError
from skinbus.estimate import LEVELS
from skinbus.skin.contact import CONTACT, UNKNOWN_LEVEL
from skinbus.skin.cycle import PATCH, Cycle, SkinLayout

FOLDER: Final = Path("/dev/shm")
"""Where shm_open(3) of the C library keeps its objects on Linux."""
MAX_NAME: Final = 64
"""Characters of a name: a line of `ls -l /dev/shm` holds it."""
GROUP: Final = "skinbus"
"""Its members trust each other: the service writes, controllers of other users read."""
MAX_BYTES: Final = 16 << 20
"""More than twice the object of 1008 patches of 64 tactels."""
MAGIC: Final = int.from_bytes(b"SKINBUS1", "little")
VERSION: Final = 2
SLOTS: Final = 16
"""A reader that is held up for less than 15 cycles, 0.3 s at 50 Hz, needs one try."""
TRIES: Final = 1000
"""Of a reader that finds no whole cycle, before it says so: a writer of ours needs one or two."""
MAX_CONTACTS: Final = 64
"""As many as the tracker keeps."""
NAME_BYTES: Final = 32
RUNNING, STOPPED = 1, 2

HEADER: Final = struct.Struct("<QIIQQ8I64s3Q")
"""152 bytes at the begin: magic, version, state, newest, period_ns, n_slots, slot_bytes, first_slot,
contacts_offset, n_links, n_buses, n_patches, n_tactels, name of the arm, three digests."""
MEMBER_BYTES: Final = 16
"""Of a patch: u32 node-ID, bus, link, number of tactels."""
HEAD: Final = struct.Struct("<QQqqIIII")
"""48 bytes at the begin of a slot: sequence, number, t_ns, latency_ns, counter, level, flags, n_contacts."""
BUDGET: Final = struct.Struct("<d")
"""Before the contacts of a slot: most time of the estimator, us; NaN where it is not known."""

NEWEST: Final = 2
STATE_WORD: Final = 3
N_CONTACTS_WORD: Final = 11
"""Places: ``newest`` of the header in words of 8 bytes, ``state`` and, in a slot, ``n_contacts`` of 4."""

IS_ORDERED: Final = platform.machine() == "x86_64"
"""Whether loads and stores keep their order without a barrier."""
_FLOCK: Final = "hhqqi4x"
"""struct flock on 64-bit Linux."""


def path_of(name: str) -> Path:
    """Return the file of a name; C programs open ``/skinbus-NAME`` with shm_open."""
    if not re.fullmatch(rf"[A-Za-z0-9_.-]{{1,{MAX_NAME}}}", name):
        raise ArgumentError(
            f"{name!r} is no name for shared memory: wanted 1 to {MAX_NAME} letters, digits, - _ ."
        )
    return FOLDER / f"skinbus-{name}"


def is_written(name: str) -> bool:
    """Whether a process writes under a name now; ShareError for what is no memory of this version."""
    try:
        with closing(SharedReader(name)) as reader:
            return reader.is_alive and not reader.is_stopped
    except ShareError as error:
        if not isinstance(error.__cause__, FileNotFoundError):
            raise
    return False


class Offsets:
    """Where things are in a slot of an arm."""

    def __init__(self, n_patches: int, n_tactels: int) -> None:
        self.patches = HEAD.size
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
    level = LEVELS.index(cycle.level) if cycle.level else UNKNOWN_LEVEL
    latency_ns, flags = round(1e9 * cycle.latency_s), int(cycle.flags)
    parts = (
        HEAD.pack(2 * number, number, cycle.t_ns, latency_ns, cycle.counter, level, flags, len(records)),
        cycle.patch_records.tobytes(),
        readings.pressures.astype("<f4").tobytes(),
        readings.valid.tobytes(),
        readings.faults.tobytes(),
    )
    budget_us = math.nan if cycle.budget_us is None else cycle.budget_us
    return b"".join(parts).ljust(offsets.budget, b"\0") + BUDGET.pack(budget_us) + records.tobytes()


class _Mapped:
    """An object that is mapped: its bytes, words of 8 and of 4 bytes."""

    def __init__(self, file: int, protection: int) -> None:
        self._file = -1
        try:
            self._map = mmap.mmap(file, 0, mmap.MAP_SHARED | mmap.MAP_POPULATE, protection)
        except BaseException:
            os.close(file)
            raise
        self._file = file
        self._bytes = memoryview(self._map)
        whole = self._bytes[: len(self._bytes) // 8 * 8]
        self._words, self._halves = whole.cast("Q"), whole.cast("I")

    def close(self) -> None:
        """Let go of it; a second call does nothing."""
        if self._file < 0:
            return
        for view in (self._words, self._halves, self._bytes):
            view.release()
        self._map.close()
        os.close(self._file)
        self._file = -1


class SharedWriter(_Mapped):
    """Writes cycles; one at a time under a name."""

    def __init__(self, name: str, layout: SkinLayout) -> None:
        """Make the object.

        Raises:
            ArgumentError: it is no name.
            ShareError: another process writes under this name, somebody else's object has it, or the object
                cannot be made.
        """
        self._path = path_of(name)
        self._offsets = offsets = Offsets(len(layout.node_id), layout.n_tactels)
        columns = (layout.node_id, layout.patch_bus, layout.patch_link, layout.patch_tactels)
        members = np.stack(columns, -1).astype("<u4").tobytes()
        names = b"".join(_fixed(text) for text in (*layout.links, *layout.buses))
        self._first_slot = _aligned(HEADER.size + len(names) + len(members))
        counts = (len(layout.links), len(layout.buses), len(layout.node_id), layout.n_tactels)
        places = (SLOTS, offsets.slot_bytes, self._first_slot, offsets.contacts)
        name_bytes = layout.name.encode()[:63]
        header = HEADER.pack(
            MAGIC, VERSION, RUNNING, 0, layout.period_ns, *places, *counts, name_bytes, *layout.geometry
        )
        begin = header + names + members
        file = _create(self._path, begin, self._first_slot + SLOTS * offsets.slot_bytes)
        super().__init__(file, mmap.PROT_READ | mmap.PROT_WRITE)
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
        if self._file >= 0:
            self._halves[STATE_WORD] = STOPPED
            with suppress(FileNotFoundError):
                if self._path.stat().st_ino == os.fstat(self._file).st_ino:
                    self._path.unlink()
        super().close()


class SharedReader(_Mapped):
    """Reads cycles that another process writes."""

    def __init__(self, name: str) -> None:
        """Map the object.

        Raises:
            ArgumentError: it is no name.
            ShareError: there is none, it cannot be read, is of somebody else, or has another layout.
        """
        self._name = name
        try:
            file = _open(path_of(name))
        except FileNotFoundError as error:
            raise ShareError(f"no shared memory {name!r}: does `skinbus run --share {name}` run?") from error
        try:
            super().__init__(file, mmap.PROT_READ)
            self.layout, self.offsets = self._read_layout()
        except ValueError as error:
            self.close()
            raise ShareError(f"shared memory {name!r} is not of this version of skinbus") from error

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
        start = self._first_slot + number % SLOTS * self.offsets.slot_bytes
        if self._words[start // 8] != 2 * number:
            return None
        barrier()
        n_contacts = min(self._halves[start // 4 + N_CONTACTS_WORD], MAX_CONTACTS)
        copy = self._map[start : start + self.offsets.contacts + n_contacts * CONTACT.itemsize]
        barrier()
        return copy if self._words[start // 8] == 2 * number else None

    def read_from(self, number: int, margin: int = 0) -> tuple[int, bytes]:
        """Return the number and a copy of the cycle with a number, or of the oldest that is there after it.

        ``margin``: slots that are not counted on. The number is 0 where there is none yet.

        Raises:
            ShareError: none is whole, however often that is tried: no writer of ours wrote this.
        """
        for _ in range(TRIES):
            newest = self.newest
            if newest < max(number, 1):
                return 0, b""
            oldest = max(number, newest - SLOTS + 1 + margin, 1)
            if (data := self.read(oldest)) is not None:
                return oldest, data
        raise ShareError(f"shared memory {self._name!r} holds no whole cycle")

    def _read_layout(self) -> tuple[SkinLayout, Offsets]:
        """Return what does not change; ValueError when it is not of this version, or its sizes do not fit."""
        header = HEADER.unpack(self._map[: HEADER.size].ljust(HEADER.size))
        n_links, n_buses, n_patches, n_tactels, name, *geometry = header[9:]
        offsets, names_at = Offsets(n_patches, n_tactels), HEADER.size
        members_at = names_at + NAME_BYTES * (n_links + n_buses)
        self._first_slot = first_slot = _aligned(members_at + n_patches * MEMBER_BYTES)
        wanted = (MAGIC, VERSION, SLOTS, offsets.slot_bytes, first_slot, offsets.contacts)
        if header[:2] + header[5:9] != wanted or len(self._map) < first_slot + SLOTS * offsets.slot_bytes:
            raise ValueError
        names = [
            self._map[at : at + NAME_BYTES].rstrip(b"\0").decode(errors="replace")
            for at in range(names_at, members_at, NAME_BYTES)
        ]
        table = np.frombuffer(self._map, "<u4", 4 * n_patches, members_at).reshape(-1, 4).astype(np.int64)
        node_id, bus, link, tactels = table.T.astype(np.int32)
        is_whole = (table[:, 1] < n_buses).all() and (table[:, 2] < n_links).all()
        if not is_whole or table[:, 3].sum() != n_tactels or not header[4]:
            raise ValueError
        layout = SkinLayout(
            name.rstrip(b"\0").decode(errors="replace"),
            tuple(names[:n_links]),
            tuple(names[n_links:]),
            node_id,
            bus,
            link,
            tactels,
            header[4],
            geometry=tuple(geometry),
        )
        return layout, offsets


def is_locked(file: int) -> bool:
    """Whether the process that writes is there: whether its lock is held."""
    asked = struct.pack(_FLOCK, fcntl.F_RDLCK, 0, 0, 0, 0)
    return bool(struct.unpack(_FLOCK, fcntl.fcntl(file, fcntl.F_OFD_GETLK, asked))[0] != fcntl.F_UNLCK)


def _open(path: Path) -> int:
    """Return the descriptor of an object to be read; nothing is followed, waited for, or taken from others.

    Raises:
        FileNotFoundError: there is none.
        ShareError: it cannot be opened, is no plain file, or is of somebody else.
    """
    status = path.lstat()
    try:
        owner = pwd.getpwuid(status.st_uid).pw_name
    except KeyError:
        owner = str(status.st_uid)
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise ShareError(f"{path} of user {owner} cannot be opened: {error.strerror}") from error
    status = os.fstat(file)
    fault = ""
    if not stat.S_ISREG(status.st_mode):
        fault = "is no plain file"
    elif status.st_uid not in (0, os.geteuid()) and status.st_gid != _group():
        fault = f"is neither yours nor root's nor of group {GROUP}"
    elif status.st_mode & 0o022:
        fault = "can be written by others"
    elif status.st_size > MAX_BYTES:
        fault = f"has {status.st_size} bytes; wanted at most {MAX_BYTES}"
    if fault:
        os.close(file)
        raise ShareError(f"{path} of user {owner} {fault}")
    return file


def _group() -> int | None:
    """Return the group whose members trust each other; None where there is none."""
    try:
        return grp.getgrnam(GROUP).gr_gid
    except KeyError:
        return None


def _create(path: Path, begin: bytes, n_bytes: int) -> int:
    """Return the descriptor of a new object, locked, which got its name when all was in it."""
    with suppress(FileNotFoundError):
        old = _open(path)
        try:
            if not is_locked(old):  # its writer has ended
                path.unlink(missing_ok=True)
        finally:
            os.close(old)
    try:
        file = os.open(FOLDER, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o644)
        try:
            os.posix_fallocate(file, 0, n_bytes)  # no room is an error here, not a signal later
            os.write(file, begin)
            fcntl.fcntl(file, fcntl.F_OFD_SETLK, struct.pack(_FLOCK, fcntl.F_WRLCK, 0, 0, 0, 0))
            os.link(f"/proc/self/fd/{file}", path, src_dir_fd=file)  # with it linkat(2) follows the link
        except BaseException:
            os.close(file)
            raise
    except FileExistsError:
        raise ShareError(f"shared memory {path.name!r} is in use by another process") from None
    except OSError as error:
        raise ShareError(f"shared memory {path.name!r} cannot be made: {error.strerror}") from error
    return file


def _aligned(n: int) -> int:
    return -(-n // 8) * 8


def _fixed(text: str) -> bytes:
    """Return a name in its place; what is too long is cut between two characters."""
    return text.encode()[: NAME_BYTES - 1].decode(errors="ignore").encode().ljust(NAME_BYTES, b"\0")
