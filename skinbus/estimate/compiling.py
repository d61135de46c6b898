"""Notices that numba compiles instead of loading from its cache, and tells who wants to know."""

from __future__ import annotations

from collections.abc import Callable

from numba.core import event


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
