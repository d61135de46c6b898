"""The machine's monotonic clock, and the accuracy of its timers."""

from __future__ import annotations

import ctypes
import sys
import time

_PR_SET_TIMERSLACK = 29  # linux/prctl.h
_LOOKS = 5
"""At both clocks: a process that loses the CPU between two of them would shift all its times of day."""


class MonotonicClock:
    """The machine's monotonic clock; steps of the wall clock do not touch it."""

    def __init__(self) -> None:
        looks = [(time.monotonic_ns(), time.time_ns(), time.monotonic_ns()) for _ in range(_LOOKS)]
        before_ns, wall_ns, after_ns = min(looks, key=lambda look: look[2] - look[0])
        self._wall_offset_ns = wall_ns - (before_ns + after_ns) // 2

    def now_ns(self) -> int:
        """Time now (ns)."""
        return time.monotonic_ns()

    def wall_ns(self, t_ns: int) -> int:
        """Unix time (ns) of ``t_ns``, by the wall clock as it stood when this clock was made."""
        return t_ns + self._wall_offset_ns


def sharpen_timers() -> None:
    """Let the calling thread's waits end in time, not up to 50 us later, where the system can."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
