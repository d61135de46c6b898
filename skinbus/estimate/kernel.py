"""How every kernel is compiled: cached, without the GIL, exact arithmetic; dividing by 0 gives infinity.

Kernels of a cycle are compiled without numba's run time for memory: they cannot allocate, and no references
to the arrays of a workspace are counted, which took two thirds of their time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "fastmath": False, "error_model": "numpy"}
_CYCLE: dict[str, Any] = {**_OPTIONS, "_nrt": False}
_BARE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def kernel(function: F) -> F:
    """Compile a kernel that Python calls in every cycle; Python holds the arrays while it runs."""
    compiled: F = njit(**_CYCLE)(function)
    return compiled


def setup(function: F) -> F:
    """Compile a kernel that Python calls once, to make arrays."""
    compiled: F = njit(**_OPTIONS)(function)
    return compiled


def part(function: F) -> F:
    """Compile a kernel that only kernels call: without wrappers, which would be most of its compile time."""
    compiled: F = njit(**_CYCLE, **_BARE)(function)
    return compiled


@part
def number(n: int) -> int:
    """Return n as a plain integer: numba compiles a callee anew for each literal that is handed to it."""
    return n + 0
