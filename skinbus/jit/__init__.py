"""How every kernel is compiled: exact arithmetic, without the GIL, kept on disk; x / 0 is infinite.

Kernels of a cycle are compiled without numba's run time for memory: they cannot allocate, and no references
to the arrays of a workspace are counted, which took two thirds of their time.

``kernel_files`` says where compiled kernels are kept, ``sources`` what they are made from; ``internals``
holds all that is private to numba.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from numba import njit
from numba.core import event

from skinbus.jit.cycle_compiler import CycleCompiler, InnerCompiler
from skinbus.jit.internals import KernelCache
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
    if (
        hasattr(compiled, "_cache")
        and function.__closure__ is None
        and "<locals>" not in function.__qualname__
        and file
    ):
        compiled._cache = KernelCache(function, sources_stamp(file))
    typed: F = compiled
    return typed


@inner_kernel
def runtime_int(n: int) -> int:
    """Return n as a plain integer: numba compiles a callee anew for each literal that is handed to it."""
    return n + 0


class CompileRefused(Exception):
    """A kernel would have to be compiled."""


class _Refusal(event.Listener):
    """Raises CompileRefused instead of compiling."""

    def on_start(self, event: object) -> None:
        raise CompileRefused

    def on_end(self, event: object) -> None:
        pass


@contextmanager
def refuse_compiling() -> Iterator[None]:
    """Raise CompileRefused where a kernel is not kept: what is kept is loaded."""
    refusal = _Refusal()
    event.register("numba:compile", refusal)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        event.unregister("numba:compile", refusal)  # type: ignore[no-untyped-call]


class Interruption(event.Listener):
    """Raises KeyboardInterrupt between two kernels that are compiled while it is open, once it is asked to.

    A signal handler that raises within numba or LLVM leaves them in the middle of something.
    """

    def __init__(self, is_asked: Callable[[], bool]) -> None:
        self._is_asked = is_asked

    def on_start(self, event: object) -> None:
        if self._is_asked():
            raise KeyboardInterrupt

    def on_end(self, event: object) -> None:
        pass

    def __enter__(self) -> Interruption:
        event.register("numba:compile", self)  # type: ignore[no-untyped-call]
        return self

    def __exit__(self, *exc: object) -> None:
        event.unregister("numba:compile", self)  # type: ignore[no-untyped-call]


class CompileWatch(event.Listener):
    """Is called, while it is open, for everything that numba compiles."""

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
