"""Clock drift: every board's oscillator is a little off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockDrift(Effect):
    """Heartbeats, event and inhibit times of each node run at a rate of their own."""

    name = "clock_drift"
    stage = Stage.CLOCK
    # crystals are specified to +-30 to +-50 ppm; RC oscillators of microcontrollers to 1 % (10 000 ppm)
    sigma_ppm: Annotated[float, parameter("ppm", "standard deviation of the rate", ge=0, le=100_000)] = 30.0

    def bind(self, arm: Arm, rng: np.random.Generator) -> Callable[[Floats], None]:
        """Return ``step(ppm)``, which adds the rates."""
        rates = self.sigma_ppm * rng.standard_normal(arm.n_patches)

        def step(ppm: Floats) -> None:
            ppm += rates

        return step
