"""How every kernel is compiled: exact arithmetic, without the GIL, kept on disk; x / 0 is infinite.

Kernels of a cycle are compiled without numba's run time for memory: they cannot allocate, and no references
to the arrays of a workspace are counted, which took two thirds of their time.

``kernel_files`` keeps compiled kernels on disk, ``sources`` says what they are made from, ``cycle_compiler``
and ``internals`` extend numba.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from numba import njit
from numba.core import event

from skinbus.jit.cycle_compiler import CycleCompiler, InnerCompiler
from skinbus.jit.kernel_files import KernelCache
from skinbus.jit.sources import sources_stamp

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "fastmath": False,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,  # nothing calls a kernel from C
}
_CYCLE: dict[str, Any] = {**_OPTIONS, "_nrt": False, "pipeline_class": CycleCompiler}
_INNER: dict[str, Any] = {**_CYCLE, "no_cpython_wrapper": True, "pipeline_class": InnerCompiler}


def kernel(function: F) -> F:
    """Compile a kernel that Python calls in every cycle; Python holds the arrays while it runs."""
    return _kept(function, njit(**_CYCLE)(function))


def setup(function: F) -> F:
    """Compile a kernel that may allocate: Python calls it once, to make arrays."""
    return _kept(function, njit(**_OPTIONS)(function))


def inner_kernel(function: F) -> F:
    """Compile a kernel that only kernels call: without wrappers, optimised as a part of its callers."""
    compiled: F = njit(**_INNER)(function)
    return compiled


def _kept(function: F, compiled: Any) -> F:
    """Give a kernel its place on disk: what is kept is out of date as soon as a source of it has changed."""
    file = getattr(sys.modules.get(function.__module__), "__file__", None)
    if file and function.__closure__ is None and "<locals>" not in function.__qualname__:
        compiled._cache = KernelCache(function, sources_stamp(file))
    typed: F = compiled
    return typed


@inner_kernel
def runtime_int(n: int) -> int:
    """Return n as a plain integer: numba compiles a callee anew for each literal that is handed to it."""
    return n + 0


class CompileRefused(Exception):
    """A kernel would have to be compiled."""


class _Listener(event.Listener):
    """Calls a function before each compilation."""

    def __init__(self, call: Callable[[], object]) -> None:
        self._call = call

    def on_start(self, event: object) -> None:
        self._call()

    def on_end(self, event: object) -> None:
        pass


@contextmanager
def on_compile(call: Callable[[], object]) -> Iterator[None]:
    """Call a function before each kernel that is compiled, and not before those that are loaded.

    It may raise: between two kernels is the only safe place to interrupt numba and LLVM.
    """
    with event.install_listener("numba:compile", _Listener(call)):
        yield


def refuse() -> None:
    """Raise CompileRefused: for :func:`on_compile`, where kernels may be loaded only."""
    raise CompileRefused
