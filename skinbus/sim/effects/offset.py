"""Offset: tactels do not read zero when nothing presses."""

from __future__ import annotations

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, PressureStep, Stage, parameter, settings


@settings
class Offset(Effect):
    """Each tactel has a zero of its own, fixed for the run."""

    stage = Stage.TACTEL
    # assumed: 0.1 % of a full scale of 250 kPa, the zero error of an amplifier with 5 mV at 5 V
    sigma_pa: float = parameter(250.0, "Pa", "standard deviation of the zero", ge=0)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        zero = self.sigma_pa * rng.standard_normal(arm.n_tactels)
        return lambda pressures, t_s: pressures + zero
