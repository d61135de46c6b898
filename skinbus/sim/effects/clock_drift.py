"""Clock drift: every board's oscillator is a little off."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, Stage, parameter, settings


@settings
class ClockDrift(Effect):
    """Heartbeats, event and inhibit times of each node run at a rate of their own."""

    stage = Stage.CLOCK
    # crystals are specified to +-30 to +-50 ppm; RC oscillators of microcontrollers to 1 % (10 000 ppm)
    sigma_ppm: float = parameter(30.0, "ppm", "standard deviation of the rate", ge=0, le=100_000)

    def bind(self, arm: Arm, rng: np.random.Generator) -> Callable[[Floats], Floats]:
        """Return ``step(ppm) -> ppm``, which adds the rates."""
        rates = self.sigma_ppm * rng.standard_normal(arm.n_patches)
        return lambda ppm: ppm + rates
