"""Gain spread: tactels differ in sensitivity from what their calibration says."""

from __future__ import annotations

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, PressureStep, Stage, parameter, settings


@settings
class GainSpread(Effect):
    """Each tactel's pressure is multiplied by a factor of its own, fixed for the run."""

    stage = Stage.TACTEL
    # FlexiForce A201 datasheet: repeatability +-2.5 %, what calibration leaves at best
    sigma: float = parameter(0.025, "", "standard deviation of the factor about 1", ge=0, le=1)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        factor = 1.0 + self.sigma * rng.standard_normal(arm.n_tactels)
        return lambda pressures, t_s: pressures * factor
