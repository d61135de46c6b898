"""Compiled kernels on disk: one file each, with a checksum, named by sources, versions and processor.

A file holds executable code: its folder belongs to the user who runs it, and nobody else may write there.
A damaged file is removed, and its kernel is compiled again. Where no folder can be written, kernels are
compiled at every start. A wheel may ship kernels, which are used where the folder has none.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target
from numba.core.serialize import dumps

from skinbus.file_bytes import cache_home, write_whole

SUFFIX = ".kernel"
log = logging.getLogger(__name__)


@dataclass
class KernelFolder:
    """A folder of compiled kernels; ``path`` is None where none can be used, ``fault`` says why."""

    path: Path | None
    fault: str = ""

    def load(self, name: str) -> bytes | None:
        """Return a kernel, None if there is none; remove it if it is damaged."""
        try:
            content = (self.path / (name + SUFFIX)).read_bytes() if self.path is not None else None
        except OSError:
            content = None
        if content is None:
            return None
        payload = content[32:]
        if content[:32] == hashlib.sha256(payload).digest():
            return payload
        self.discard(name, f"{len(content)} bytes with a wrong checksum")
        return None

    def save(self, name: str, payload: bytes) -> None:
        """Write a kernel as a whole; after a fault, no more."""
        if self.path is None:
            return
        try:
            write_whole(self.path / (name + SUFFIX), hashlib.sha256(payload).digest() + payload, 0o600)
        except OSError as error:
            log.warning("kernel cache: %s; kernels are compiled without one", error)
            self.path, self.fault = None, str(error)

    def discard(self, name: str, fault: str) -> None:
        """Remove a kernel that cannot be used."""
        log.warning("kernel cache: %s is damaged (%s): compiled anew", name, fault)
        if self.path is not None:
            with suppress(OSError):  # of a wheel, in a folder of root
                (self.path / (name + SUFFIX)).unlink()

    def names(self) -> list[str]:
        """Return the names of all kernels."""
        return [] if self.path is None else [path.stem for path in self.path.glob("*" + SUFFIX)]


@cache
def shipped_kernels() -> KernelFolder:
    """Return the kernels of a wheel of ``tools/wheel``, for any processor: NUMBA_CPU_NAME=generic."""
    return KernelFolder(Path(__file__).parent / "kernels")


@cache
def kernel_folder() -> KernelFolder:
    """Return the folder of this user, which all installations share.

    It lies in ``NUMBA_CACHE_DIR``, or else in ``skinbus`` in the user's cache folder.
    """
    try:
        root = Path(os.environ.get("NUMBA_CACHE_DIR") or cache_home())
        path = root / f"kernels-{sys.implementation.cache_tag}"
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = path.lstat()
    except (OSError, RuntimeError) as error:  # RuntimeError: a user without a home
        return KernelFolder(None, str(error))
    if status.st_uid != os.geteuid() or status.st_mode & 0o022:
        return KernelFolder(None, f"{path} belongs to another user, or can be written by other users")
    return KernelFolder(path)


class KernelCache(_Cache):
    """numba's interface to the files of one kernel, by the types of its arguments."""

    def __init__(self, function: Callable[..., Any], stamp: str) -> None:
        self._kernel = f"{function.__module__}.{function.__qualname__}.{stamp[:16]}"

    @property
    def cache_path(self) -> Any:
        return kernel_folder().path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel for a signature, None where it has to be compiled."""
        target_context.refresh()
        triple, *processor = target_context.codegen().magic_tuple()
        for folder, made_for in ((kernel_folder(), processor), (shipped_kernels(), ["generic", ""])):
            name = self._name(sig, (triple, *made_for))
            payload = folder.load(name)
            if payload is not None:
                try:
                    return CompileResult._rebuild(cpu_target.target_context, *pickle.loads(payload))
                except Exception as error:  # noqa: BLE001 whatever is wrong with it: it can be made anew
                    folder.discard(name, f"{type(error).__name__}: {error}")
        return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        codegen = cres.library.codegen
        for env in cres._find_referenced_environments():  # of the inner kernels that it contains
            if codegen._engine.is_symbol_defined(env.env_name):
                codegen.set_env(env.env_name, env)
        if kernel_folder().path is not None and not cres.library.has_dynamic_globals:
            name = self._name(sig, cres.library.codegen.magic_tuple())
            kernel_folder().save(name, dumps(cres._reduce()))

    def flush(self) -> None:
        """Do nothing: what is kept is out of date when its name no longer fits."""

    enable = disable = flush

    def _name(self, sig: Any, machine: tuple[str, ...]) -> str:
        flags: Any = numba.config
        key = str(sig), machine, flags.OPT, flags.BOUNDSCHECK, numba.__version__, llvmlite.__version__
        return f"{self._kernel}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}"
