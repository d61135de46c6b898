"""Clocks in nanoseconds: the interface, and a virtual clock that moves when it is set."""

from __future__ import annotations

from typing import Protocol


class Clock(Protocol):
    """A clock that never goes back; its zero means nothing, only differences do."""

    def now_ns(self) -> int:
        """Time now (ns)."""

    def wall_ns(self, t_ns: int) -> int:
        """The Unix time (ns) at which this clock showed ``t_ns``; what recordings hold."""


class VirtualClock:
    """A clock that stands still until it is moved; hours pass in seconds."""

    __slots__ = ("_t_ns",)

    def __init__(self, t_ns: int = 0) -> None:
        self._t_ns = t_ns

    def now_ns(self) -> int:
        """Time now (ns)."""
        return self._t_ns

    def wall_ns(self, t_ns: int) -> int:
        """Unix time (ns) of ``t_ns``: the virtual world begins with the epoch."""
        return t_ns

    def move_to(self, t_ns: int) -> None:
        """Let it be ``t_ns``; a clock never goes back, an earlier time raises ValueError."""
        if t_ns < self._t_ns:
            raise ValueError(f"t_ns is {t_ns}; wanted at least {self._t_ns}")
        self._t_ns = t_ns
