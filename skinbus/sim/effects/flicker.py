"""Flicker noise: power falls as one over the frequency.

A sum of first-order random states with time constants a factor q apart and equal variance has, between the
inverses of the longest and the shortest, the one-sided density S(f) = A^2 / f with variance A^2 ln q of each
state. A state is drawn anew only once an eighth of its time constant has passed, so slow ones cost nothing.
Source: P. Dutta, P. M. Horn, Rev. Mod. Phys. 53, 497 (1981): 1/f from a spread of relaxation times.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter, settings

RATIO: Final = 4.0
"""Of neighbouring time constants; the ripple of the density is then below 2 %."""
_REFRESH: Final = 0.125


@settings
class Flicker(Effect):
    """1/f noise of every tactel, independent of all others."""

    stage = Stage.TACTEL
    # assumed: at 1 Hz as strong as 200 Pa of white noise sampled at 50 Hz is there, 200 / sqrt(25)
    pa_at_1hz: float = parameter(40.0, "Pa/sqrt(Hz)", "amplitude density at 1 Hz", ge=0)
    low_hz: float = parameter(0.01, "Hz", "flat below this frequency", gt=0)
    high_hz: float = parameter(50.0, "Hz", "falls faster above this frequency", gt=0)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        longest, shortest = 1.0 / (math.tau * self.low_hz), 1.0 / (math.tau * self.high_hz)
        n = max(1, 1 + round(math.log(max(longest / shortest, 1.0)) / math.log(RATIO)))
        taus = (longest / RATIO ** np.arange(n)).tolist()
        sigma = self.pa_at_1hz * math.sqrt(math.log(RATIO))
        states = sigma * rng.standard_normal((n, arm.n_tactels))
        drawn = [math.nan] * n

        def step(pressures: Floats, t_s: float) -> Any:
            for k, tau in enumerate(taus):
                if not t_s >= drawn[k]:  # the first sample, or a scene that begins anew
                    drawn[k] = t_s
                elif t_s - drawn[k] >= _REFRESH * tau:
                    keep = math.exp(-(t_s - drawn[k]) / tau)
                    fresh = sigma * math.sqrt(1.0 - keep * keep) * rng.standard_normal(arm.n_tactels)
                    states[k] = keep * states[k] + fresh
                    drawn[k] = t_s
            return pressures + states.sum(axis=0)

        return step
