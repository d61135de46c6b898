"""Gain spread: tactels differ in sensitivity from what their calibration says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class GainSpread(Effect):
    """Each tactel's pressure is multiplied by a factor of its own, fixed for the run."""

    name = "gain_spread"
    stage = Stage.TACTEL
    # FlexiForce A201 datasheet: repeatability +-2.5 %, what calibration leaves at best
    sigma: Annotated[float, parameter("", "standard deviation of the factor about 1", ge=0, le=1)] = 0.025

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        factor = 1.0 + self.sigma * rng.standard_normal(arm.n_tactels)

        def step(pressures: Floats, t_s: float) -> None:
            pressures *= factor

        return step
