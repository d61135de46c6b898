"""Drift: under constant load the reading keeps growing, by a share of the load in every decade of time.

    y(t) = p (1 + d log10(1 + t / t0))    for a load p since t = 0

A sum of first-order states with time constants one decade apart, each with weight d, grows like that from t0
on (the ripple is 2 % of one decade's drift), and recovers in the same way when the load is gone.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter, settings

_EULER: Final = math.exp(0.5772156649015329)
"""The sum of 1 - exp(-t/tau) over decades of tau is log10(t/first) + 1/2 + log10(e^gamma) in the middle."""


@settings
class Drift(Effect):
    """Logarithmic creep of loaded tactels."""

    stage = Stage.TACTEL
    # FlexiForce A201 datasheet: drift < 5 % per logarithmic time scale, at 90 % of full load
    per_decade: float = parameter(0.05, "", "share of the load gained per decade of time", ge=0, le=1)
    first_s: float = parameter(1.0, "s", "where the logarithm begins", gt=0)
    decades: int = parameter(5, "", "decades that the drift lasts", ge=1, le=12)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        # log10(1 + t/t0) is the sum with the first time constant half a decade, less Euler's constant, above
        # t0
        taus = self.first_s * _EULER * math.sqrt(10.0) * 10.0 ** np.arange(self.decades)[:, None]
        state, last = np.zeros((self.decades, arm.n_tactels)), math.nan

        def step(pressures: Floats, t_s: float) -> Any:
            nonlocal last
            elapsed, last = max(0.0, t_s - last) if last == last else 0.0, t_s
            state[:] -= np.expm1(-elapsed / taus) * (pressures - state)
            return pressures + self.per_decade * state.sum(axis=0)

        return step
