"""Noise: white, independent between tactels and samples."""

from __future__ import annotations

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, PressureStep, Stage, parameter, settings


@settings
class Noise(Effect):
    """Normally distributed noise on every reading."""

    stage = Stage.TACTEL
    # 1 % of the peak of a contact; a board declares 200 Pa (model.Patch)
    sigma_pa: float = parameter(200.0, "Pa", "standard deviation", ge=0)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        return lambda pressures, t_s: pressures + self.sigma_pa * rng.standard_normal(arm.n_tactels)
