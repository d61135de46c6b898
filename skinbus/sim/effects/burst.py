"""Burst: electromagnetic interference, spikes that neighbouring tactels and successive samples share.

A burst strikes one board: every tactel within ``radius_mm`` of a random one, the farther the less (a
Gaussian), with one sign, for ``duration_ms``, falling exponentially. IEC 61000-4-4 has such bursts last 15
ms.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter, settings

_OVER: Final = 5.0
"""Durations after which a burst is over: 0.7 % of it is left."""


@settings
class Burst(Effect):
    """Random bursts on every board, independent of all others."""

    stage = Stage.TACTEL
    # assumed: a relay or a motor brake beside one of 24 boards, once in some seconds of work
    per_minute: float = parameter(1.0, "1/min", "mean number on each board", ge=0)
    kpa: float = parameter(20.0, "kPa", "standard deviation of the height", ge=0)
    radius_mm: float = parameter(12.0, "mm", "how far over the board it reaches", gt=0)
    duration_ms: float = parameter(15.0, "ms", "time in which it falls to 1/e", gt=0)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        mean_s = 60.0 / self.per_minute if self.per_minute > 0.0 else np.inf
        next_s = mean_s * rng.standard_exponential(arm.n_patches)
        begun_s = np.full(arm.n_patches, -np.inf)  # of the last burst of each board
        heights = np.zeros(arm.n_tactels)
        tau_s = 1e-3 * self.duration_ms

        def step(pressures: Floats, t_s: float) -> Any:
            while next_s.min() <= t_s:
                patch = int(next_s.argmin())
                uv = arm.patches[patch].patch.tactels_uv
                height = 1e3 * self.kpa * rng.standard_normal()
                centre = uv[rng.integers(len(uv))]
                squares = ((uv - centre) ** 2).sum(axis=1) / (1e-3 * self.radius_mm) ** 2
                heights[arm.tactels_of(patch)] = height * np.exp(-0.5 * squares)
                begun_s[patch] = next_s[patch]
                next_s[patch] += mean_s * rng.standard_exponential()
            age = (t_s - begun_s) / tau_s
            return pressures + np.where(age > _OVER, 0.0, np.exp(-age))[arm.tactel_patch] * heights

        return step
