"""Offset: tactels do not read zero when nothing presses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Offset(Effect):
    """Each tactel has a zero of its own, fixed for the run."""

    name = "offset"
    stage = Stage.TACTEL
    # assumed: 0.1 % of a full scale of 250 kPa, the zero error of an amplifier with 5 mV at 5 V
    sigma_pa: Annotated[float, parameter("Pa", "standard deviation of the zero", ge=0)] = 250.0

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        zero = self.sigma_pa * rng.standard_normal(arm.n_tactels)

        def step(pressures: Floats, t_s: float) -> None:
            pressures += zero

        return step
