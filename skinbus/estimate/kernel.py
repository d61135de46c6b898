"""How every kernel is compiled: cached, without the GIL, exact arithmetic; dividing by 0 gives infinity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "fastmath": False, "error_model": "numpy"}
_BARE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def kernel(function: F) -> F:
    """Compile a kernel that Python calls."""
    compiled: F = njit(**_OPTIONS)(function)
    return compiled


def part(function: F) -> F:
    """Compile a kernel that only kernels call: without wrappers, which would be most of its compile time."""
    compiled: F = njit(**_OPTIONS, **_BARE)(function)
    return compiled


@part
def number(n: int) -> int:
    """Return n as a plain integer: numba compiles a callee anew for each literal that is handed to it."""
    return n + 0
