"""Clocks: what time it is, in nanoseconds; the machine's, or a virtual one that moves when told."""

from __future__ import annotations

import ctypes
import sys
import time
from typing import Final, Protocol

_PR_SET_TIMERSLACK: Final = 29  # linux/prctl.h


class Clock(Protocol):
    """A clock that never goes back; its zero means nothing, only differences do."""

    def now_ns(self) -> int:
        """Time now (ns)."""

    def wall_ns(self, t_ns: int) -> int:
        """The Unix time (ns) at which this clock showed ``t_ns``; what recordings hold."""


class MonotonicClock:
    """The machine's monotonic clock; steps of the wall clock do not touch it."""

    def __init__(self) -> None:
        self._wall_offset_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Time now (ns)."""
        return time.monotonic_ns()

    def wall_ns(self, t_ns: int) -> int:
        """Unix time (ns) of ``t_ns``, by the wall clock as it stood when this clock was made."""
        return t_ns + self._wall_offset_ns


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


def sharpen_timers() -> bool:
    """Let the calling thread's waits end in time, not up to 50 us later; True where the system can."""
    if not sys.platform.startswith("linux"):
        return False
    return bool(ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0)
