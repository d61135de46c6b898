"""Counters of a network interface: frames that the kernel dropped before any socket received them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

LOOK_EVERY_NS: Final = 5_000_000
"""Time between looks at the interface's counter, 5 us each: a loss is reported in its own cycle."""


class Statistic:
    """A counter of an interface (/sys/class/net/NAME/statistics/...), read as often as is asked for."""

    def __init__(self, file: Path) -> None:
        try:
            self._fd = os.open(file, os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            self._fd = -1

    def read(self) -> int | None:
        """The counter; None if it cannot be read or the interface is gone."""
        try:
            return int(os.pread(self._fd, 32, 0)) if self._fd >= 0 else None
        except (OSError, ValueError):
            return None

    def close(self) -> None:
        """Let go of the file; a second call does nothing."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


class BacklogDrops:
    """Counts received frames that were lost before they came to any socket, since it was made.

    A kernel that is too busy to hand frames on queues a thousand of them (net.core.netdev_max_backlog) and
    drops the rest; so does a driver without memory. No socket reports these: they are the interface's
    ``rx_dropped``. Where that cannot be read, nothing is counted.
    """

    def __init__(self, statistic: Statistic) -> None:
        self.n = 0
        self._next_ns = 0
        self._statistic = statistic
        self._before = statistic.read() or 0

    def look(self) -> None:
        """Bring ``n`` up to date."""
        value = self._statistic.read()
        if value is not None:
            self.n = max(value - self._before, self.n)

    def look_at_times(self, now_ns: int) -> None:
        """Do so if the last look was some time ago."""
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + LOOK_EVERY_NS
            self.look()

    def close(self) -> None:
        """Let go of the counter; ``n`` stays."""
        self._statistic.close()
