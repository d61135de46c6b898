"""The file of an object of shared memory: its name, and the lock that shows whether its writer lives."""

from __future__ import annotations

import fcntl
import os
import re
import struct
from pathlib import Path
from typing import Final

from skinbus.errors import ShareError

FOLDER: Final = Path("/dev/shm")
"""Where shm_open(3) of the C library keeps its objects on Linux."""

_FLOCK: Final = "hhqqi4x"
"""struct flock on 64-bit Linux."""


MAX_NAME: Final = 64
"""Characters of a name: a line of `ls -l /dev/shm` holds it."""


def path_of(name: str) -> Path:
    """Return the file of a name; C programs open ``/skinbus-NAME`` with shm_open."""
    if not re.fullmatch(rf"[A-Za-z0-9_.-]{{1,{MAX_NAME}}}", name):
        raise ShareError(
            f"{name!r} is no name for shared memory: wanted 1 to {MAX_NAME} letters, digits, - _ ."
        )
    return FOLDER / f"skinbus-{name}"


def is_locked(file: int) -> bool:
    """Whether the process that writes is there: whether its lock is held."""
    asked = struct.pack(_FLOCK, fcntl.F_RDLCK, 0, 0, 0, 0)
    return bool(struct.unpack(_FLOCK, fcntl.fcntl(file, fcntl.F_OFD_GETLK, asked))[0] != fcntl.F_UNLCK)


def create(path: Path, begin: bytes, n_bytes: int) -> int:
    """Return the descriptor of a new object, locked, which got its name when all was in it."""
    new = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        _remove_dead(path)
        new.unlink(missing_ok=True)
        file = os.open(new, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        try:
            os.posix_fallocate(file, 0, n_bytes)  # no room is an error here, not a signal later
            os.write(file, begin)
            fcntl.fcntl(file, fcntl.F_OFD_SETLK, struct.pack(_FLOCK, fcntl.F_WRLCK, 0, 0, 0, 0))
            os.link(new, path)
        except BaseException:
            os.close(file)
            raise
        finally:
            new.unlink(missing_ok=True)
    except FileExistsError:
        raise ShareError(f"shared memory {path.name!r} is in use by another process") from None
    except OSError as error:
        raise ShareError(f"shared memory {path.name!r} cannot be made: {error.strerror}") from error
    return file


def _remove_dead(path: Path) -> None:
    """Remove an object whose writer process has ended."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return
    try:
        if not is_locked(file):
            path.unlink(missing_ok=True)
    finally:
        os.close(file)
