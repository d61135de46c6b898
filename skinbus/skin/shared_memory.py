"""Cycles in POSIX shared memory: one process writes, others read without waiting for it.

Layout, version 3; little-endian, aligned by their size; see ``docs/shared-memory.md``::

    header   HEADER             what does not change, and the number of the newest cycle
    names    NAME each          UTF-8, padded with zeros: the links, then the buses
    patches  four u32 each      node-ID, bus, link, number of tactels
    slots    slot_dtype each    cycle n is in slot n % SLOTS

A slot is under a sequence lock: ``sequence`` is 2n - 1 while cycle n is written and 2n when it is whole. The
writer goes round all slots, so a reader has SLOTS - 1 cycles to copy one and is never held up; what it has
copied is whole if the sequence was 2n before and after. A writer that ends in the middle of a cycle leaves
the one before it as the newest.

The writer holds a lock of its open file on the object: the kernel releases it when the process ends, however
it ends. ``state`` shows that it was stopped; the age of the newest cycle shows that it hangs.

Memory order: the stores of the sequence, of the data and of ``newest`` must be seen in their order. On x86
they are anyway; elsewhere a barrier stands between them: a lock released and taken again.
"""

from __future__ import annotations

import fcntl
import grp
import math
import mmap
import os
import pwd
import re
import stat
import struct
import threading
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skinbus.arrays import Bytes
from skinbus.errors import ArgumentError, ShareError
from skinbus.skin.layout import SkinLayout
from skinbus.skin.records import CONTACT, PATCH, UNKNOWN_LEVEL

if TYPE_CHECKING:
    from skinbus.skin.cycle import Cycle

FOLDER = Path("/dev/shm")
"""Where shm_open(3) of the C library keeps its objects on Linux."""
MAX_NAME = 64
"""Characters of a name: a line of `ls -l /dev/shm` holds it."""
GROUP = "skinbus"
"""Its members trust each other: the service writes, controllers of other users read."""
MAX_BYTES = 16 << 20
"""More than twice the object of 1008 patches of 64 tactels."""
MAGIC = b"SKINBUS1"
VERSION = 3
SLOTS = 16
"""A reader that is held up for less than 15 cycles, 0.3 s at 50 Hz, needs one try."""
TRIES = 1000
"""Of a reader that finds no whole cycle, before it says so: a writer of ours needs one or two."""
MAX_CONTACTS = 64
"""As many as the tracker keeps."""
RUNNING, STOPPED = 1, 2

_COUNTS = ("n_links", "n_buses", "n_patches", "n_tactels")
HEADER = np.dtype(
    [
        ("magic", "S8"),
        ("version", "<u4"),
        ("state", "<u4"),
        ("newest", "<u8"),
        ("period_ns", "<u8"),
        *((name, "<u4") for name in ("n_slots", "slot_bytes", "first_slot", "contacts_offset", *_COUNTS)),
        ("name", "S64"),
        ("geometry", "<u8"),
    ]
)
NAME = np.dtype("S32")

_FLOCK = "hhqqi4x"
"""struct flock on 64-bit Linux."""


def path_of(name: str) -> Path:
    """Return the file of a name; C programs open ``/skinbus-NAME`` with shm_open."""
    if not re.fullmatch(rf"[A-Za-z0-9_.-]{{1,{MAX_NAME}}}", name):
        raise ArgumentError(
            f"{name!r} is no name for shared memory: wanted 1 to {MAX_NAME} letters, digits, - _ ."
        )
    return FOLDER / f"skinbus-{name}"


def name_for(file: str) -> str:
    """Return the usual name for the arm of a file."""
    return re.sub(r"[^A-Za-z0-9_.-]", "-", Path(file).stem)[:MAX_NAME]


def slot_dtype(n_patches: int, n_tactels: int) -> np.dtype[np.void]:
    """Return what a slot of an arm holds; ValueError for numbers that cannot be."""
    head = [("sequence", "<u8"), ("number", "<u8"), ("t_ns", "<i8"), ("latency_ns", "<i8")]
    head += [(name, "<u4") for name in ("counter", "level", "flags", "n_contacts")]
    return np.dtype(
        [
            *head,
            ("patches", PATCH, (n_patches,)),
            ("pressures", "<f4", (n_tactels,)),
            ("valid", np.bool_, (n_tactels,)),
            ("faults", np.uint8, (n_tactels,)),
            ("padding", np.uint8, (-6 * n_tactels % 8,)),
            ("budget_us", "<f8"),
            ("contacts", CONTACT, (MAX_CONTACTS,)),
        ]
    )


def _places(
    n_links: int, n_buses: int, n_patches: int, n_tactels: int
) -> tuple[np.dtype[np.void], int, int, dict[str, Any]]:
    """Return a slot, where patches and slots begin, and what a header has for these counts."""
    slot = slot_dtype(n_patches, n_tactels)
    members_at = HEADER.itemsize + NAME.itemsize * (n_links + n_buses)
    first = members_at + 16 * n_patches
    fixed = {"magic": MAGIC, "version": VERSION, "n_slots": SLOTS, "slot_bytes": slot.itemsize}
    contacts = slot.itemsize - MAX_CONTACTS * CONTACT.itemsize
    return slot, members_at, first, fixed | {"first_slot": first, "contacts_offset": contacts}


def fill(slot: np.void, cycle: Cycle, number: int) -> None:
    """Write a cycle to a slot, but for its sequence."""
    from skinbus.estimate import LEVELS  # not for readers: a guard does without the estimator

    records, readings = cycle.records[:MAX_CONTACTS], cycle.readings
    slot["number"], slot["t_ns"], slot["latency_ns"] = number, cycle.t_ns, round(1e9 * cycle.latency_s)
    slot["level"] = LEVELS.index(cycle.level) if cycle.level else UNKNOWN_LEVEL
    slot["counter"], slot["flags"], slot["n_contacts"] = cycle.counter, int(cycle.flags), len(records)
    slot["patches"], slot["contacts"][: len(records)] = cycle.patch_records, records
    for name in ("pressures", "valid", "faults"):
        slot[name] = getattr(readings, name)
    slot["budget_us"] = math.nan if cycle.budget_us is None else cycle.budget_us


def barrier() -> None:
    """Let no load or store pass, either way: a lock that is released and taken again does that."""
    lock = threading.Lock()
    for _ in range(2):
        with lock:
            pass


class _Mapped:
    """An object that is mapped."""

    _file = -1
    _header: Any
    _slots: Any

    def _map(self, file: int, protection: int) -> Any:
        """Map it, and return its bytes."""
        self._file = file
        return np.frombuffer(mmap.mmap(file, 0, mmap.MAP_SHARED | mmap.MAP_POPULATE, protection), np.uint8)

    def close(self) -> None:
        """Let go of it; a second call does nothing."""
        if self._file >= 0:
            self._header = self._slots = None
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
        counts = (len(layout.links), len(layout.buses), len(layout.node_id), layout.n_tactels)
        slot, _, first, fixed = _places(*counts)
        header = np.zeros(1, HEADER)
        said = {"state": RUNNING, "period_ns": layout.period_ns, "name": layout.name.encode()[:63]}
        said |= {"geometry": layout.geometry, **dict(zip(_COUNTS, counts, strict=True))}
        for key, value in (fixed | said).items():
            header[key] = value
        names = np.array(
            [text.encode()[: NAME.itemsize - 1] for text in (*layout.links, *layout.buses)], NAME
        )
        columns = (layout.node_id, layout.patch_bus, layout.patch_link, layout.patch_tactels)
        begin = header.tobytes() + names.tobytes() + np.stack(columns, -1).astype("<u4").tobytes()
        file = _create(self._path, begin, first + SLOTS * slot.itemsize)
        memory = self._map(file, mmap.PROT_READ | mmap.PROT_WRITE)
        self._header = memory[: HEADER.itemsize].view(HEADER)
        self._slots = memory[first:].view(slot)
        self._number = 0

    def write(self, cycle: Cycle) -> None:
        """Write a cycle; readers see it whole or not at all."""
        self._number = n = self._number + 1
        slot = self._slots[n % SLOTS]
        slot["sequence"] = 2 * n - 1
        barrier()
        fill(slot, cycle, n)
        barrier()
        slot["sequence"] = 2 * n
        barrier()
        self._header["newest"] = n

    def close(self) -> None:
        """Say that it is over and remove the name; readers keep what they have."""
        if self._file >= 0:
            self._header["state"] = STOPPED
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
            self.layout = self._read_layout(self._map(file, mmap.PROT_READ))
        except ValueError as error:
            self.close()
            raise ShareError(f"shared memory {name!r} is not of this version of skinbus") from error

    @property
    def newest(self) -> int:
        """Number of the newest cycle; 0 when there is none yet."""
        return int(self._header["newest"][0])

    @property
    def is_stopped(self) -> bool:
        """Whether the writer was stopped."""
        return bool(self._header["state"][0] != RUNNING)

    @property
    def is_alive(self) -> bool:
        """Whether the process that writes is there: whether its lock is held."""
        return is_locked(self._file)

    def read(self, number: int) -> np.void | None:
        """Return a copy of the slot of a cycle; None when it is there no more. It is whole."""
        slot = self._slots[number % SLOTS]
        if slot["sequence"] != 2 * number:
            return None
        barrier()
        copy: np.void = slot.copy()
        barrier()
        return copy if slot["sequence"] == 2 * number else None

    def read_from(self, number: int, margin: int = 0) -> np.void | None:
        """Return a copy of the cycle with a number, or of the oldest that is there after it.

        ``margin``: slots that are not counted on. None where there is none yet.

        Raises:
            ShareError: none is whole, however often that is tried: no writer of ours wrote this.
        """
        for _ in range(TRIES):
            newest = self.newest
            if newest < max(number, 1):
                return None
            oldest = max(number, newest - SLOTS + 1 + margin, 1)
            if (data := self.read(oldest)) is not None:
                return data
        raise ShareError(f"shared memory {self._name!r} holds no whole cycle")

    def _read_layout(self, memory: Bytes) -> SkinLayout:
        """Return what does not change; ValueError when it is not of this version, or its sizes do not fit."""
        self._header = memory[: HEADER.itemsize].view(HEADER)
        header = self._header[0].copy()  # what is checked is what is used
        n_links, n_buses, n_patches, n_tactels = counts = [int(header[name]) for name in _COUNTS]
        slot, members_at, first, fixed = _places(*counts)
        is_ours = all(header[key] == value for key, value in fixed.items()) and header["period_ns"]
        if not is_ours or len(memory) < first + SLOTS * slot.itemsize:
            raise ValueError
        self._slots = memory[first : first + SLOTS * slot.itemsize].view(slot)
        texts = memory[HEADER.itemsize : members_at].view(NAME).tolist()
        name, *names = (text.decode(errors="ignore") for text in (header["name"].item(), *texts))
        members = memory[members_at : members_at + 16 * n_patches].view("<u4").reshape(-1, 4).T
        if (members[1] >= n_buses).any() or (members[2] >= n_links).any() or members[3].sum() != n_tactels:
            raise ValueError
        node_id, bus, link, tactels = members.astype(np.int32)
        return SkinLayout(
            name,
            tuple(names[:n_links]),
            tuple(names[n_links:]),
            node_id,
            bus,
            link,
            tactels,
            int(header["period_ns"]),
            geometry=int(header["geometry"]),
        )


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
