"""Files as bytes: only regular ones of a bounded size are read; written as a whole or not at all."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from skinbus.errors import ConfigError, Fault, MissingFileError


def read_bytes(path: Path, most: int, error: type[ConfigError] = ConfigError) -> bytes:
    """Return the bytes of a file.

    Raises:
        ConfigError: or the given kind of it: it cannot be read, is no regular file, or has more than ``most``
            bytes.
    """
    try:
        with open(path, "rb", opener=_open) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise error(str(path), [Fault("file", None, "a regular file")])
            content = file.read(most + 1)
    except OSError as cause:
        wanted = f"one that can be read ({cause.strerror})"
        is_missing = isinstance(cause, FileNotFoundError) and error is ConfigError
        raise (MissingFileError if is_missing else error)(str(path), [Fault("file", None, wanted)]) from cause
    if len(content) > most:
        raise error(str(path), [Fault("file", None, f"at most {most} bytes")])
    return content


def _open(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # a pipe without writer does not block


def write_whole(path: Path, content: bytes, mode: int, before: Path | None = None) -> None:
    """Put content in the place of a file, all of it or nothing, whatever ends the program.

    before: where the file that it replaces stays
    """
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_NOFOLLOW", 0)
    try:
        with open(os.open(unfinished, flags, mode), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        if before is not None and path.exists():
            os.replace(path, before)
        os.replace(unfinished, path)
    except OSError:
        unfinished.unlink(missing_ok=True)
        raise


def cache_home() -> Path:
    """Return the folder of this user for what can be made again."""
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (given if given.is_absolute() else Path.home() / ".cache") / "skinbus"
