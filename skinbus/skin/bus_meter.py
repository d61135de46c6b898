"""How much of its time each bus is taken: frames with the worst stuffing, over the last second."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from skinbus.can.frame import EXTENDED, MAX_DATA, Frame, FrameBatch
from skinbus.model import BusSettings
from skinbus.objects.bus_load import worst_ns

BIN_NS: Final = 100_000_000
N_BINS: Final = 10
"""Bins of 0.1 s that a load is over: long against a cycle, and as often renewed as people look."""
EXTENDED_BITS: Final = 25
"""More of a frame with a 29-bit identifier, at worst: 20 bits and their stuffing."""


class BusMeter:
    """Takes frames in the order of their times; what is not passed on to it is not counted."""

    def __init__(self, buses: Sequence[BusSettings]) -> None:
        self._ns = np.array([[worst_ns(n, bus) for n in range(MAX_DATA + 1)] for bus in buses])
        self._more_ns = np.array([EXTENDED_BITS * 1_000_000_000 // bus.bitrate for bus in buses])
        self._busy = np.zeros((N_BINS + 1, len(buses)))
        self._first: int | None = None
        self._bin = 0

    def take(self, frame: Frame, now_ns: int) -> None:
        """Take one frame."""
        self._go_to(now_ns)
        extended = self._more_ns[frame.bus] if frame.flags & EXTENDED else 0
        self._busy[self._bin % (N_BINS + 1), frame.bus] += self._ns[frame.bus, len(frame.data)] + extended

    def take_batch(self, batch: FrameBatch, now_ns: int) -> None:
        """Take a batch of frames of the data plane, which have 11-bit identifiers."""
        self._go_to(now_ns)
        frames = batch.frames[: batch.n]
        taken_ns = self._ns[frames["bus"], frames["length"]]
        self._busy[self._bin % (N_BINS + 1)] += np.bincount(frames["bus"], taken_ns, self._busy.shape[1])

    def loads(self, now_ns: int) -> tuple[float, ...]:
        """Return the share of the last second, or of the time so far, that frames took on each bus."""
        self._go_to(now_ns)
        if self._first is None or self._bin == self._first:
            return (0.0,) * self._busy.shape[1]
        n_whole = min(self._bin - self._first, N_BINS)
        whole = [(self._bin - 1 - k) % (N_BINS + 1) for k in range(n_whole)]
        return tuple((self._busy[whole].sum(0) / (n_whole * BIN_NS)).tolist())

    def _go_to(self, now_ns: int) -> None:
        """Begin the bin of a time, and empty those that were left out; an earlier time stays in the bin."""
        number = now_ns // BIN_NS
        if self._first is None:
            self._first = self._bin = number
        for k in range(self._bin + 1, min(number, self._bin + N_BINS + 1) + 1):
            self._busy[k % (N_BINS + 1)] = 0.0
        self._bin = max(self._bin, number)
