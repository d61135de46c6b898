"""Readings on the bus as pressures: calibrated and judged as by a master, with zeros of the listener's own.

The zeros of the master are not on the bus. Those here are found in the same way from the same readings, but
since the listener began: until half a second has passed untouched, pressures count from the calibration.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from skinbus.can.frame import FrameBatch
from skinbus.estimate import Baseline, Plausibility
from skinbus.model import Arm
from skinbus.objects.readings import ReadingsPlan
from skinbus.skin.cycle import Readings


class ListenedReadings:
    """Gathers the readings between the summaries of a master, which come when all of a cycle are in."""

    def __init__(self, arm: Arm, plan: ReadingsPlan) -> None:
        self._arm = arm
        self._plan = plan
        self._counts = np.zeros(arm.n_tactels, np.int32)
        self._seen = np.zeros(arm.n_patches, np.int32)
        self._scale = plan.counts_scale * arm.tactel_gain
        self._baseline = Baseline(arm)
        self._plausibility = Plausibility(arm)
        self._wanted: deque[int | None] = deque()

    def take(self, batch: FrameBatch) -> None:
        """Take data frames."""
        self._plan.unpack(batch, self._counts, self._seen)

    def end_cycle(self, t_ns: int) -> Readings:
        """Return the readings since the last cycle; a patch of which a frame is missing has none."""
        fresh = (self._seen == self._plan.expected) & (self._plan.expected != 0)
        self._seen[:] = 0
        pressures = (self._counts - self._plan.counts_offset) * self._scale
        self._plausibility.judge(pressures, t_ns, fresh, self._baseline)
        self._baseline.apply(pressures, t_ns, fresh)
        while self._wanted:
            self._baseline.zero(self._wanted.popleft())
        faults = self._plausibility.faults.astype(np.uint8)
        valid = fresh[self._arm.tactel_patch] & self._arm.tactel_healthy & (faults == 0)
        return Readings(np.where(valid, pressures, 0.0), valid, faults)

    def zero(self, patch: int | None) -> None:
        """Take what is read in the next cycle for zero, on one patch or all; from any thread."""
        self._wanted.append(patch)
