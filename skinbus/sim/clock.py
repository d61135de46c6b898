"""Scene time and bus time: which sample was taken when."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from math import inf
from typing import Final

_HISTORY: Final = 4096
_S: Final = 1_000_000_000


class SceneClock:
    """Maps bus time (ns) to scene time (s): by counting SYNCs, or by the bus clock itself."""

    def __init__(self, period_s: float, *, follows: str, repeat_s: float = inf) -> None:
        """``repeat_s``: the scene begins anew after so long."""
        self._period_s = period_s
        self._repeat_s = repeat_s
        self._by_sync = follows == "sync"
        self._begin_ns: int | None = None
        self._times: deque[int] = deque(maxlen=_HISTORY)
        self.n_samples = 0
        self.now_s = 0.0
        """Scene time of the last sample, s."""

    def begin(self, now_ns: int) -> None:
        """The bus clock at scene time 0, unless SYNCs are counted."""
        if self._begin_ns is None:
            self._begin_ns = now_ns

    def tick(self, now_ns: int) -> float:
        """A SYNC came: return the scene time of its sample (s)."""
        self._times.append(now_ns)
        self.n_samples += 1
        count_s = (self.n_samples - 1) * self._period_s % self._repeat_s
        self.now_s = count_s if self._by_sync else self.at(now_ns)
        return self.now_s

    def at(self, t_ns: int) -> float:
        """Return the scene time at a bus time (s); of the latest SYNC up to then if SYNCs are counted."""
        if not self._by_sync:
            return 0.0 if self._begin_ns is None else (t_ns - self._begin_ns) / _S % self._repeat_s
        index = bisect_right(self._times, t_ns)
        return max(0, self.n_samples - len(self._times) + index - 1) * self._period_s % self._repeat_s
