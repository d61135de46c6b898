"""Latency as anybody on the bus can measure it: from SYNC, and from a touch, to the contact TPDO.

A patch samples with the SYNC, so a touch that comes at any time of the period before waits for it: a cycle
with period T whose last contact came L after its SYNC stands for touches that were L to L + T old,
all equally likely. Failure: on a bus whose frames are stamped late, their delay counts as latency.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.can.frame import Frame
from skinbus.objects import cia
from skinbus.objects.published import usual

Floats = npt.NDArray[np.float64]

REMEMBERED: Final = 100_000
"""Cycles that percentiles are made of, the last of a long run."""
WAITS: Final = (np.arange(50) + 0.5) / 50
"""Of a touch for its SYNC, in periods."""


class LatencyLog:
    """Takes frames of a bus and keeps the latencies of its cycles."""

    def __init__(self, node_id: int) -> None:
        self.n_cycles = 0
        """Cycles in which a contact was published."""
        self._contact_ids = frozenset(usual(node_id).contact_ids)
        self._cycles: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)
        """Latency and period (ns)."""
        self._sync_ns = self._period_ns = self._contact_ns = 0

    @property
    def sync_to_contact(self) -> Floats:
        """Of each cycle, ms."""
        return np.array([latency for latency, _ in self._cycles]) / 1e6

    @property
    def touch_to_contact(self) -> Floats:
        """Of touches, ms: as many for each cycle, over its period."""
        periods = np.array([period for _, period in self._cycles]) / 1e6
        return np.asarray(self.sync_to_contact[:, None] + periods[:, None] * WAITS).ravel()

    def take(self, frames: Sequence[Frame]) -> None:
        """Take frames in the order of their stamps; a cycle without a contact says nothing."""
        for frame in frames:
            if frame.can_id == cia.SYNC_ID:
                if self._period_ns and self._contact_ns > self._sync_ns:
                    self.n_cycles += 1
                    self._cycles.append((self._contact_ns - self._sync_ns, self._period_ns))
                self._period_ns = frame.t_ns - self._sync_ns if self._sync_ns else 0
                self._sync_ns, self._contact_ns = frame.t_ns, 0
            elif frame.can_id in self._contact_ids:
                self._contact_ns = frame.t_ns

    def spread(self, latencies: Floats) -> dict[str, float]:
        """Return the percentiles of one of the two, and its maximum, ms; none before the first cycle."""
        if not len(latencies):
            return {}
        values = np.percentile(latencies, (50, 95, 99, 100)).round(2).tolist()
        return dict(zip(("p50", "p95", "p99", "max"), values, strict=True))
