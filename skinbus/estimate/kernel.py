"""How every kernel is compiled: cached, without the GIL, exact arithmetic; dividing by 0 gives infinity.

Kernels of a cycle are compiled without numba's run time for memory: they cannot allocate, and no references
to the arrays of a workspace are counted, which took two thirds of their time.

A kernel contains all that it calls, but numba's cache only asks whether the file it stands in has changed:
what was compiled of the others, days ago, would go on running. Here the whole folder has to be as it was.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "fastmath": False, "error_model": "numpy"}
_CYCLE: dict[str, Any] = {**_OPTIONS, "_nrt": False}
_BARE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def sources_stamp(folder: Path) -> str:
    """Return what changes with any source of a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


_STAMP = sources_stamp(Path(__file__).parent)


def kernel(function: F) -> F:
    """Compile a kernel that Python calls in every cycle; Python holds the arrays while it runs."""
    return _compile(function, **_CYCLE)


def setup(function: F) -> F:
    """Compile a kernel that Python calls once, to make arrays."""
    return _compile(function, **_OPTIONS)


def part(function: F) -> F:
    """Compile a kernel that only kernels call: without wrappers, which would be most of its compile time."""
    return _compile(function, **_CYCLE, **_BARE)


def _compile(function: F, **options: Any) -> F:
    compiled: F = njit(**options)(function)
    cache = getattr(compiled, "_cache", None)  # uncompiled, a function is what it was
    if cache is not None:
        cache._cache_file._source_stamp = (cache._cache_file._source_stamp, _STAMP)
    return compiled


@part
def number(n: int) -> int:
    """Return n as a plain integer: numba compiles a callee anew for each literal that is handed to it."""
    return n + 0
