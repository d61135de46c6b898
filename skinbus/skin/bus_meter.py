"""How much of its time each bus is taken: frames with the worst stuffing, over the last second."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from skinbus.can.frame import MAX_DATA, Frame, FrameBatch
from skinbus.model import BusSettings
from skinbus.objects.bus_load import worst_ns

SPAN_NS: Final = 1_000_000_000


class BusMeter:
    """Takes frames, which have 11-bit identifiers; what is not passed on to it is not counted."""

    def __init__(self, buses: Sequence[BusSettings]) -> None:
        self._ns = np.array([[worst_ns(n, bus) for n in range(MAX_DATA + 1)] for bus in buses])
        self._busy_ns = np.zeros(len(buses))
        self._begin_ns = 0
        self._loads = (0.0,) * len(buses)

    def take(self, frame: Frame) -> None:
        """Take one frame."""
        self._busy_ns[frame.bus] += self._ns[frame.bus, len(frame.data)]

    def take_batch(self, batch: FrameBatch) -> None:
        """Take a batch of frames."""
        bus, length = batch.frames["bus"][: batch.n], batch.frames["length"][: batch.n]
        self._busy_ns += np.bincount(bus, self._ns[bus, length], len(self._busy_ns))

    def loads(self, now_ns: int) -> tuple[float, ...]:
        """Return the share of the last whole second that frames took on each bus; 0 before there is one."""
        if (elapsed_ns := now_ns - self._begin_ns) >= SPAN_NS:
            self._loads = tuple((self._busy_ns / elapsed_ns).tolist())
            self._begin_ns = now_ns
            self._busy_ns[:] = 0.0
        return self._loads
