"""How every kernel is compiled: cached, without the GIL, exact arithmetic; dividing by 0 gives infinity.

Kernels of a cycle are compiled without numba's run time for memory: they cannot allocate, and no references
to the arrays of a workspace are counted, which took two thirds of their time.

A kernel contains all that it calls, but numba's cache only compares the file it stands in: what was compiled
of the others, days ago, would go on running. Here the whole part of skinbus that it belongs to is compared.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from numba import njit
from numba.core import event

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "fastmath": False, "error_model": "numpy"}
_CYCLE: dict[str, Any] = {**_OPTIONS, "_nrt": False}
_BARE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def sources_stamp(folder: Path) -> str:
    """Return what changes with any source of a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


@cache
def _stamp_of(part: str) -> str:
    """Return the stamp of a part of skinbus (``estimate``, ``sim``, ...) and of this file."""
    here = Path(__file__)
    return sources_stamp(here.parent / part) + hashlib.sha256(here.read_bytes()).hexdigest()


def kernel(function: F) -> F:
    """Compile a kernel that Python calls in every cycle; Python holds the arrays while it runs."""
    return _compile(function, **_CYCLE)


def setup(function: F) -> F:
    """Compile a kernel that Python calls once, to make arrays."""
    return _compile(function, **_OPTIONS)


def inner_kernel(function: F) -> F:
    """Compile a kernel that only kernels call: without wrappers, which would be most of its compile time."""
    return _compile(function, **_CYCLE, **_BARE)


def _compile(function: F, **options: Any) -> F:
    compiled: F = njit(**options)(function)
    kept = getattr(compiled, "_cache", None)  # uncompiled, a function is what it was
    names = function.__module__.split(".")
    if kept is not None and names[0] == "skinbus" and len(names) > 1:
        kept._cache_file._source_stamp = (kept._cache_file._source_stamp, _stamp_of(names[1]))
    return compiled


@inner_kernel
def runtime_int(n: int) -> int:
    """Return n as a plain integer: numba compiles a callee anew for each literal that is handed to it."""
    return n + 0


class CompileWatch(event.Listener):
    """Is told, while it is open, of everything that numba compiles."""

    def __init__(self, on_compile: Callable[[], None] | None) -> None:
        self._tell = on_compile
        self.compiled = False

    def on_start(self, event: object) -> None:
        if not self.compiled:
            self.compiled = True
            if self._tell is not None:
                self._tell()

    def on_end(self, event: object) -> None:
        pass

    def __enter__(self) -> CompileWatch:
        event.register("numba:compile", self)  # type: ignore[no-untyped-call]
        return self

    def __exit__(self, *exc: object) -> None:
        event.unregister("numba:compile", self)  # type: ignore[no-untyped-call]
