"""A callable that reads a sensor as the source of a patch, called by a thread of its own.

What it returns is a sample of the time at which it returned. Whatever it does, what is sent is a sample not
older than ``MAX_AGE_NS``, or nothing.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from skinbus.arrays import Floats
from skinbus.can.clock import Clock
from skinbus.node.host import Sample

MAX_AGE_NS = 100_000_000
"""A sensor that gives nothing for so long has stopped: five periods at 50 Hz, the oldest that arms take."""


class Reader:
    """Counts of one patch.

    Args:
        read: returns counts (n_tactels,), left-adjusted; NaN, or masked, for a tactel that has no reading.
            It may wait.
        n_tactels: of the patch.
        bits: of a reading in its object, 8 or 16.
        say: gets what is wrong with ``read`` when that begins; "" when it is over.
    """

    def __init__(
        self,
        read: Callable[[], Any],
        n_tactels: int,
        bits: int,
        say: Callable[[str], object] = lambda text: None,
    ) -> None:
        self._read, self._say = read, say
        self._limits = -(1 << bits - 1), (1 << bits - 1) - 1
        self._none = np.zeros(n_tactels, np.bool_)
        self._sample = Sample(np.zeros(n_tactels, np.int32), np.zeros(1, np.int64), self._none)
        self.fault = ""
        """What was wrong when it was called last."""

    def newest(self, now_ns: int) -> Sample:
        """Return the newest sample; without healthy tactels if it is too old. Any thread may call it."""
        sample = self._sample
        if now_ns - sample.t_ns[0] > MAX_AGE_NS:
            return sample._replace(healthy=self._none)
        return sample

    def run(self, clock: Clock, period_s: float, stop: threading.Event) -> None:
        """Call it once in each period until ``stop`` is set; without a pause where it takes longer."""
        due_ns = clock.now_ns()
        while not stop.wait(max(1e-9 * (due_ns - clock.now_ns()), 0.0)):
            self.call(clock)
            due_ns = max(due_ns + round(1e9 * period_s), clock.now_ns())

    def call(self, clock: Clock) -> None:
        """Take one sample; one that fails, or is none, leaves no healthy tactel."""
        low, high = self._limits
        fault = ""
        counts, healthy = self._sample.counts, self._none
        try:
            counted = np.ma.asarray(self._read()).astype(np.float64, casting="same_kind")
            values: Floats = np.ma.filled(counted, np.nan)
        except BaseException as error:  # noqa: BLE001 - the user's own code, whatever it does
            fault = f"{type(error).__name__}: {error}"
        else:
            there = np.isfinite(values)
            if values.shape != self._none.shape:
                fault = f"returned shape {values.shape}; wanted {self._none.shape}"
            elif ((values[there] < low) | (values[there] > high)).any():
                fault = f"returned {values[there].min():g} to {values[there].max():g}; wanted {low} to {high}"
            else:
                counts = np.where(there, values, low).astype(np.int32)
                healthy = there
        self._sample = Sample(counts, np.array([clock.now_ns()]), healthy)
        if bool(fault) is not bool(self.fault):  # texts may have times in them
            self._say(fault)
        self.fault = fault
