"""SYNC jitter: the producer's timer, and with it the instant of sampling, is not exact."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Stage, parameter, settings


@settings
class SyncJitter(Effect):
    """All patches sample at the same wrong instant, normally distributed about the right one."""

    stage = Stage.TIME
    # a thread that waits for a timer on a desktop Linux wakes some 50 us to 1 ms late; cyclictest calls 100
    # us good
    sigma_us: float = parameter(200.0, "us", "standard deviation of the sampling instant", ge=0)

    def bind(self, arm: Arm, rng: np.random.Generator) -> Callable[[float], float]:
        """Return ``step(t_s) -> t_s``."""
        return lambda t_s: t_s + 1e-6 * self.sigma_us * rng.standard_normal()
