"""Latency as anybody on the bus can measure it: from SYNC, and from a touch, to the contact TPDO.

A patch samples with the SYNC, so a touch that comes at any time of the period before waits for it: a cycle
with period T whose last contact came L after its SYNC stands for touches that were L to L + T old,
all equally likely. Failure: on a bus whose frames are stamped late, their delay counts as latency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.can.frame import Frame
from skinbus.objects import cia, profile
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import tpdos

BIN_NS: Final = 100_000
"""A frame at 1 Mbit/s: nothing on the bus is known better."""
N_BINS: Final = 20_000
"""Two seconds; what takes longer counts as that."""


@dataclass(frozen=True, slots=True)
class LatencySpread:
    """How a latency spreads, ms."""

    p50: float
    p95: float
    p99: float
    max: float


class LatencyLog:
    """Takes frames of a bus and sorts the latencies of its cycles into bins.

    ``sync_to_contact`` and ``touch_to_contact`` are (N_BINS,) weights: cycles for every BIN_NS.
    """

    def __init__(self, node_id: int) -> None:
        od = load_eds("skin-master", node_id)
        first = od[profile.contact(1).object].index
        self._contact_ids = frozenset(
            pdo.cob_id
            for pdo in tpdos(od)
            if pdo.entries and 0 <= pdo.entries[0].index - first < profile.MAX_CONTACTS
        )
        self.sync_to_contact = np.zeros(N_BINS)
        self.touch_to_contact = np.zeros(N_BINS)
        self.n_cycles = 0
        """Cycles in which a contact was published."""
        self._sync_ns = self._period_ns = 0
        self._contact_ns = 0

    def take(self, frames: Sequence[Frame]) -> None:
        """Take frames in the order of their stamps."""
        for frame in frames:
            if frame.can_id == cia.SYNC_ID:
                self._end_cycle()
                self._period_ns = frame.t_ns - self._sync_ns if self._sync_ns else 0
                self._sync_ns, self._contact_ns = frame.t_ns, 0
            elif frame.can_id in self._contact_ids:
                self._contact_ns = frame.t_ns

    def spread(self, bins: npt.NDArray[np.float64]) -> LatencySpread | None:
        """Return the percentiles of one of the two, to half a bin; None before the first cycle."""
        total = float(bins.sum())
        if not total:
            return None
        reached = np.cumsum(bins) / total
        # the last bin that holds anything is the largest latency, whatever rounding makes of the sum
        places = [int(np.searchsorted(reached, share)) for share in (0.5, 0.95, 0.99)]
        places.append(int(np.flatnonzero(bins)[-1]))
        return LatencySpread(*(round((min(place, places[-1]) + 0.5) * BIN_NS / 1e6, 2) for place in places))

    def _end_cycle(self) -> None:
        """Sort the cycle that a SYNC has ended into the bins; one without a contact says nothing."""
        latency_ns = self._contact_ns - self._sync_ns
        if not self._period_ns or latency_ns <= 0:
            return
        self.n_cycles += 1
        first = min(latency_ns // BIN_NS, N_BINS - 1)
        last = min((latency_ns + self._period_ns) // BIN_NS, N_BINS - 1)
        self.sync_to_contact[first] += 1.0
        self.touch_to_contact[first : last + 1] += 1.0 / (last + 1 - first)
