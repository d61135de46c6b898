"""Saturation: electronics clip before the converter does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Saturation(Effect):
    """No reading above a limit."""

    name = "saturation"
    stage = Stage.TACTEL
    # assumed: an amplifier set for 60 % of the boards' full scale of 250 kPa
    limit_kpa: Annotated[float, parameter("kPa", "largest pressure that is resolved", gt=0)] = 150.0

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        limit = 1e3 * self.limit_kpa

        def step(pressures: Floats, t_s: float) -> None:
            np.minimum(pressures, limit, out=pressures)

        return step
