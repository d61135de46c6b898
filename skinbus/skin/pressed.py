"""Loads of boards, links and the arm from the readings of a cycle, the same from every source.

A tactel counts as touched from its threshold on, without the hysteresis of a master; without its zeros'
history the deviations of loads are not known here.
"""

from __future__ import annotations

import numpy as np

from skinbus.estimate import LoadMeter
from skinbus.estimate import Loads as Loads
from skinbus.model import Arm
from skinbus.skin.cycle import Readings


class PressedLoads:
    """Measures the loads of an arm."""

    def __init__(self, arm: Arm) -> None:
        self._threshold = arm.tactel_threshold
        self._meter = LoadMeter(arm)

    def of(self, readings: Readings) -> Loads:
        """Return the loads of a cycle; a tactel without a reading counts as the mean of its neighbours."""
        touched = readings.valid & (readings.pressures >= self._threshold)
        return self._meter.measure(np.where(readings.valid, readings.pressures, np.nan), touched)
