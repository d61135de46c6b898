"""Back-off of patches that do not keep running: how long the next start of each is put off."""

from __future__ import annotations

from typing import Final

import numpy as np

STABLE_NS: Final = 30_000_000_000
"""A patch that has run for so long is stable: its next restart is at once. No longer than the longest delay,
so that one that fails once in each delay is not taken for a stable one."""

FIRST_DELAY_NS: Final = 1_000_000_000
LONGEST_DELAY_NS: Final = 30_000_000_000


class Restarts:
    """Delays of 0, 0, 1, 2, 4 ... 30 s between the starts of a patch that stops running soon after each."""

    def __init__(self, n_patches: int) -> None:
        self._n_unstable = np.zeros(n_patches, np.int64)
        self._until = np.zeros(n_patches, np.int64)

    def failed(self, now_ns: int, p: int, started_ns: int) -> int:
        """Note that patch p, started at ``started_ns``, has stopped running; return its delay (ns)."""
        n = self._n_unstable[p] = 1 if now_ns - started_ns >= STABLE_NS else self._n_unstable[p] + 1
        delay_ns = min(FIRST_DELAY_NS << min(int(n) - 2, 5), LONGEST_DELAY_NS) if n > 1 else 0
        self._until[p] = now_ns + delay_ns
        return int(delay_ns)

    def delays(self, now_ns: int, p: int) -> bool:
        """Return whether the start of patch p is put off."""
        return bool(now_ns < self._until[p])

    def forget(self, p: int | slice) -> None:
        """Start without delay: a client or a reset of the master asks for it."""
        self._n_unstable[p] = self._until[p] = 0
