"""Saturation: electronics clip before the converter does."""

from __future__ import annotations

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, PressureStep, Stage, parameter, settings


@settings
class Saturation(Effect):
    """No reading above a limit."""

    stage = Stage.TACTEL
    # assumed: an amplifier set for 60 % of the boards' full scale of 250 kPa
    limit_kpa: float = parameter(150.0, "kPa", "largest pressure that is resolved", gt=0)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        return lambda pressures, t_s: np.minimum(pressures, 1e3 * self.limit_kpa)
