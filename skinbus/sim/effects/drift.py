"""Drift: under constant load the reading keeps growing, by a share of the load in every decade of time.

    y(t) = p (1 + d log10(1 + t / t0))    for a load p since t = 0

A sum of first-order states with time constants one decade apart, each with weight d, grows like that from t0
on (the ripple is 2 % of one decade's drift), and recovers in the same way when the load is gone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np

from skinbus.jit import kernel
from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter

_EULER: Final = math.exp(0.5772156649015329)
"""The sum of 1 - exp(-t/tau) over decades of tau is log10(t/first) + 1/2 + log10(e^gamma) in the middle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift(Effect):
    """Logarithmic creep of loaded tactels."""

    name = "drift"
    stage = Stage.TACTEL
    # FlexiForce A201 datasheet: drift < 5 % per logarithmic time scale, at 90 % of full load
    per_decade: Annotated[float, parameter("", "share of the load gained per decade of time", ge=0, le=1)] = (
        0.05
    )
    first_s: Annotated[float, parameter("s", "where the logarithm begins", gt=0)] = 1.0
    decades: Annotated[int, parameter("", "decades that the drift lasts", ge=1, le=12)] = 5

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        # log10(1 + t/t0) is the sum with the first time constant half a decade, less Euler's constant, above
        # t0
        taus = self.first_s * _EULER * math.sqrt(10.0) * 10.0 ** np.arange(self.decades)
        state = np.zeros((arm.n_tactels, self.decades))
        share = np.zeros(self.decades)
        last = math.nan

        def step(pressures: Floats, t_s: float) -> None:
            nonlocal last
            share[:] = -np.expm1(-(max(0.0, t_s - last) if last == last else 0.0) / taus)
            last = t_s
            _creep(pressures, state, share, self.per_decade)

        return step


@kernel
def _creep(pressures: Floats, state: Floats, share: Floats, gain: float) -> None:
    for i in range(len(pressures)):
        p = pressures[i]
        total = 0.0
        for k in range(len(share)):
            state[i, k] += share[k] * (p - state[i, k])
            total += state[i, k]
        pressures[i] += gain * total
