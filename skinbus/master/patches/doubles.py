"""Detection of two boards under one node-ID: what one board sends once comes twice."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

N_PERIODS: Final = 3
"""Periods of one board's heartbeat that are looked at: two boards send as many heartbeats in two of them."""

LEAST_SHARE: Final = 0.75
"""Of that time; half way between one board and two, so that a heartbeat may be late by most of a period."""

N_DOUBTS: Final = 3
"""Doubts that need no second answer by SDO. A single frame may come twice: CAN repeats one of which only the
sender saw an error in the last bit."""

DOUBTS_NS: Final = 10_000_000_000
"""Time within which they count."""


class Doubles:
    """Times of the newest heartbeats of each patch since it was started, and what came twice."""

    def __init__(self, periods_ns: Sequence[int]) -> None:
        self._least_ns = np.array(
            [round(LEAST_SHARE * N_PERIODS * period) for period in periods_ns], np.int64
        )
        self._times = np.zeros((len(periods_ns), N_PERIODS), np.int64)
        self._n = np.zeros(len(periods_ns), np.int64)
        self._doubts: dict[int, list[int]] = {}
        self._why: dict[int, str] = {}

    def forget(self, p: int) -> None:
        """Begin anew, as when patch p is started."""
        self._n[p] = 0
        self._doubts.pop(p, None)

    def heartbeat(self, p: int, t_ns: int) -> bool:
        """Take a heartbeat of patch p; return whether they come too often for one board."""
        n = int(self._n[p])
        oldest = self._times[p, n % N_PERIODS]
        self._times[p, n % N_PERIODS] = t_ns
        self._n[p] = n + 1
        return bool(n >= N_PERIODS and t_ns - oldest < self._least_ns[p])

    def doubt(self, now_ns: int, p: int, why: str) -> None:
        """Note that something of patch p came twice."""
        self._n[p] = 0
        self._why[p] = why
        self._doubts[p] = [t for t in self._doubts.get(p, ()) if now_ns - t < DOUBTS_NS] + [now_ns]

    def certain(self, p: int) -> str:
        """Return what came twice, too often to be chance; else nothing."""
        return self._why[p] if len(self._doubts.get(p, ())) >= N_DOUBTS else ""
