"""Burst: electromagnetic interference, spikes that neighbouring tactels and successive samples share.

A burst strikes one board: every tactel within ``radius_mm`` of a random one, the farther the less (a
Gaussian), with one sign, for ``duration_ms``, falling exponentially. IEC 61000-4-4 has such bursts last 15
ms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter

_OVER: Final = 5.0
"""Durations after which a burst is over: 0.7 % of it is left."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Burst(Effect):
    """Random bursts on every board, independent of all others."""

    name = "burst"
    stage = Stage.TACTEL
    # assumed: a relay or a motor brake beside one of 24 boards, once in some seconds of work
    per_minute: Annotated[float, parameter("1/min", "mean number on each board", ge=0)] = 1.0
    kpa: Annotated[float, parameter("kPa", "standard deviation of the height", ge=0)] = 20.0
    radius_mm: Annotated[float, parameter("mm", "how far over the board it reaches", gt=0)] = 12.0
    duration_ms: Annotated[float, parameter("ms", "time in which it falls to 1/e", gt=0)] = 15.0

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        return _Bursts(self, arm, rng).step


class _Bursts:
    """The bursts of a run: for each board the last one and the time of the next."""

    def __init__(self, effect: Burst, arm: Arm, rng: np.random.Generator) -> None:
        self._effect, self._arm, self._rng = effect, arm, rng
        self._mean_s = 60.0 / effect.per_minute if effect.per_minute > 0.0 else math.inf
        gaps = rng.standard_exponential(arm.n_patches)
        self._next_s = self._mean_s * gaps if effect.per_minute > 0.0 else np.full(arm.n_patches, math.inf)
        self._soonest_s = float(self._next_s.min())
        self._current: dict[int, tuple[float, Floats]] = {}

    def step(self, pressures: Floats, t_s: float) -> None:
        """Add what the bursts of all boards are at a time, (n_tactels,) Pa."""
        while self._soonest_s <= t_s:
            self._strike(int(self._next_s.argmin()))
        tau_s = 1e-3 * self._effect.duration_ms
        for patch, (begun_s, heights) in list(self._current.items()):
            age = (t_s - begun_s) / tau_s
            if age > _OVER:
                del self._current[patch]
            else:
                pressures[self._arm.tactels_of(patch)] += math.exp(-age) * heights

    def _strike(self, patch: int) -> None:
        uv = self._arm.patches[patch].patch.tactels_uv
        height = 1e3 * self._effect.kpa * self._rng.standard_normal()
        centre = uv[self._rng.integers(len(uv))]
        squares = ((uv - centre) ** 2).sum(axis=1) / (1e-3 * self._effect.radius_mm) ** 2
        self._current[patch] = (float(self._next_s[patch]), height * np.exp(-0.5 * squares))
        self._next_s[patch] += self._mean_s * self._rng.standard_exponential()
        self._soonest_s = float(self._next_s.min())
