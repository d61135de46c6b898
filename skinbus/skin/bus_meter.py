"""How much of its time each bus is taken: frames with the worst stuffing, over the last second."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from skinbus.can.frame import EXTENDED, MAX_DATA, Frame, FrameBatch
from skinbus.model import BusSettings
from skinbus.objects.bus_load import worst_ns

SPAN_NS: Final = 1_000_000_000
EXTENDED_BITS: Final = 25
"""More of a frame with a 29-bit identifier, at worst: 20 bits and their stuffing."""


class BusMeter:
    """Takes frames in the order of their times; what is not passed on to it is not counted."""

    def __init__(self, buses: Sequence[BusSettings]) -> None:
        self._ns = np.array([[worst_ns(n, bus) for n in range(MAX_DATA + 1)] for bus in buses])
        self._more_ns = [EXTENDED_BITS * 1_000_000_000 // bus.bitrate for bus in buses]
        self._busy_ns = np.zeros(len(buses))
        self._begin_ns: int | None = None
        self._loads = (0.0,) * len(buses)

    def take(self, frame: Frame) -> None:
        """Take one frame."""
        more_ns = self._more_ns[frame.bus] if frame.flags & EXTENDED else 0
        self._busy_ns[frame.bus] += self._ns[frame.bus, len(frame.data)] + more_ns

    def take_batch(self, batch: FrameBatch) -> None:
        """Take a batch of frames of the data plane, which have 11-bit identifiers."""
        bus, length = batch.frames["bus"][: batch.n], batch.frames["length"][: batch.n]
        self._busy_ns += np.bincount(bus, self._ns[bus, length], len(self._busy_ns))

    def loads(self, now_ns: int) -> tuple[float, ...]:
        """Return the share of the last second, or of the time so far, that frames took on each bus."""
        if self._begin_ns is None or now_ns < self._begin_ns:
            self._begin_ns = now_ns
            self._busy_ns[:] = 0.0
        elapsed_ns, is_first = now_ns - self._begin_ns, not any(self._loads)
        if elapsed_ns >= SPAN_NS or (is_first and elapsed_ns):
            self._loads = tuple((self._busy_ns / elapsed_ns).tolist())
        if elapsed_ns >= SPAN_NS:
            self._begin_ns = now_ns
            self._busy_ns[:] = 0.0
        return self._loads
