"""Where compiled kernels are kept: one file each, verified when it is read and written as a whole.

An entry holds executable code: its folder belongs to the user who runs it, and nobody else may write there.
Any entry may vanish or be damaged at any time: it is removed, and the kernel is compiled anew. Where no
folder can be written, kernels are compiled at every start. A wheel may ship kernels, which are used where
the folder has none.
"""

from __future__ import annotations

import hashlib
import logging
import math
import os
import stat
import sys
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

MAGIC: Final = b"skinbus kernel 1\n"
SUFFIX: Final = ".kernel"
ABANDONED_S: Final = 3600.0
"""An unfinished file this old was left by a process that was killed: no kernel takes minutes to write."""
UNUSED_S: Final = 7 * 86400.0
"""An entry from other sources that was not loaded for a week belongs to no installation that is in use."""
USED_S: Final = 86400.0
"""A load is noted at most once a day: each note is a write to flash."""

log = logging.getLogger(__name__)


class KernelFolder:
    """A folder of entries; ``path`` is None where none can be used, ``fault`` says why.

    One that is ``shipped`` belongs to the package: it is only read.
    """

    def __init__(self, path: Path | None, fault: str = "", *, shipped: bool = False) -> None:
        self.path = path
        self.fault = fault
        self.shipped = shipped

    def load(self, name: str) -> bytes | None:
        """Return an entry, None if there is none; remove it if it is damaged."""
        if self.path is None:
            return None
        try:
            entry = self.path / (name + SUFFIX)
            content = entry.read_bytes()
            if not self.shipped and time.time() - entry.stat().st_mtime > USED_S:
                os.utime(entry)
        except FileNotFoundError:
            return None
        except OSError as error:
            self._give_up(error)
            return None
        payload = content[len(MAGIC) + 32 :]
        if content[: len(MAGIC) + 32] != MAGIC + hashlib.sha256(payload).digest():
            self.discard(name, f"{len(content)} bytes with a wrong checksum")
            return None
        return payload

    def save(self, name: str, payload: bytes) -> None:
        """Write an entry; those of the same kernel from other sources go unless something still uses them."""
        if self.path is None:
            return
        unfinished = self.path / f"{name}.{os.getpid()}.tmp"
        try:
            with unfinished.open("wb") as file:
                file.write(MAGIC + hashlib.sha256(payload).digest() + payload)
                file.flush()
                os.fsync(file.fileno())  # or a power loss leaves a name without its content
            unfinished.replace(self.path / (name + SUFFIX))
            self._remove_outdated(name)
        except OSError as error:
            unfinished.unlink(missing_ok=True)
            self._give_up(error)

    def discard(self, name: str, fault: str) -> None:
        """Remove an entry that cannot be used."""
        done = "not used" if self.shipped else "removed"
        log.warning("kernel cache: %s is damaged (%s): %s, compiled anew", name, fault, done)
        if self.path is not None and not self.shipped:
            try:
                (self.path / (name + SUFFIX)).unlink(missing_ok=True)
            except OSError as error:
                self._give_up(error)

    def names(self) -> Iterator[str]:
        """Yield the names of all entries."""
        if self.path is not None:
            for path in sorted(self.path.glob("*" + SUFFIX)):
                yield path.name.removesuffix(SUFFIX)

    def _remove_outdated(self, name: str) -> None:
        """Remove unused entries of a kernel with another stamp, and files of writers that were killed."""
        assert self.path is not None
        kernel, stamp, _ = name.rsplit(".", 2)
        for path in self.path.iterdir():
            parts = path.name.removesuffix(SUFFIX).rsplit(".", 2)
            is_other = path.suffix == SUFFIX and parts[0] == kernel and parts[1] != stamp
            limit_s = UNUSED_S if is_other else ABANDONED_S if path.suffix == ".tmp" else math.inf
            try:
                if time.time() - path.stat().st_mtime > limit_s:
                    path.unlink()
            except FileNotFoundError:  # another process has removed it
                pass

    def _give_up(self, error: OSError) -> None:
        """Work without a cache from here on: what failed once would fail for every kernel."""
        log.warning("kernel cache: %s; kernels are compiled without one", error)
        self.path, self.fault = None, str(error)


@cache
def shipped_kernels() -> KernelFolder:
    """Return the kernels that a wheel of ``tools/wheel`` carries, compiled for any processor."""
    path = Path(__file__).parent / "kernels"
    return KernelFolder(path if path.is_dir() else None, shipped=True)


@cache
def kernel_folder() -> KernelFolder:
    """Return the folder of this user, which all installations share: entries are named by their sources.

    It lies in ``NUMBA_CACHE_DIR``, or else in ``skinbus`` in the user's cache folder.
    """
    try:
        root = Path(os.environ.get("NUMBA_CACHE_DIR") or _user_cache() / "skinbus")
        path = root / f"kernels-{sys.implementation.cache_tag}"
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        if fault := _fault_of(path):
            return KernelFolder(None, f"{path} {fault}")
    except (OSError, RuntimeError) as error:  # RuntimeError: a user without a home
        return KernelFolder(None, str(error))
    return KernelFolder(path)


def _user_cache() -> Path:
    given = os.environ.get("XDG_CACHE_HOME", "")
    return Path(given) if Path(given).is_absolute() else Path.home() / ".cache"


def _fault_of(path: Path) -> str:
    """Return why entries of a folder must not be run or cannot be written, "" if nothing is wrong."""
    status = path.lstat()
    if not stat.S_ISDIR(status.st_mode):
        return "is not a folder"
    if hasattr(os, "geteuid") and status.st_uid != os.geteuid():
        return "belongs to another user"
    if status.st_mode & 0o022 and hasattr(os, "geteuid"):
        return "can be written by other users"
    return "" if os.access(path, os.W_OK | os.X_OK) else "cannot be written"
