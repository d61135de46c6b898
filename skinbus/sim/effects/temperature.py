"""Temperature: sensitivity grows with every degree away from where the skin was calibrated."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Temperature(Effect):
    """All tactels warm up together, from ``start_c`` to ``end_c`` away from calibration."""

    name = "temperature"
    stage = Stage.TACTEL
    # FlexiForce A201 datasheet: output changes by 0.36 % per degree C
    per_degree: Annotated[float, parameter("1/K", "change of sensitivity per degree", ge=-0.1, le=0.1)] = (
        0.0036
    )
    start_c: Annotated[float, parameter("K", "difference from calibration at scene time 0")] = 0.0
    # a robot arm's motors warm its skin by some 10 degrees within the first half hour (assumed)
    end_c: Annotated[float, parameter("K", "difference from calibration in the end")] = 10.0
    tau_s: Annotated[float, parameter("s", "time constant of the warm-up; 0 is at once", ge=0)] = 600.0

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""

        def step(pressures: Floats, t_s: float) -> None:
            left = math.exp(-max(t_s, 0.0) / self.tau_s) if self.tau_s > 0.0 else 0.0
            pressures *= 1.0 + self.per_degree * (self.end_c + (self.start_c - self.end_c) * left)

        return step
