"""Noise: white, independent between tactels and samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise(Effect):
    """Normally distributed noise on every reading."""

    name = "noise"
    stage = Stage.TACTEL
    # 1 % of the peak of a contact; a board declares 200 Pa (model.Patch)
    sigma_pa: Annotated[float, parameter("Pa", "standard deviation", ge=0)] = 200.0

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        draws = np.zeros(arm.n_tactels)

        def step(pressures: Floats, t_s: float) -> None:
            rng.standard_normal(out=draws)
            np.multiply(draws, self.sigma_pa, out=draws)
            np.add(pressures, draws, out=pressures)

        return step
