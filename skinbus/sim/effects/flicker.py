"""Flicker noise: power falls as one over the frequency.

A sum of first-order random states with time constants a factor q apart and equal variance has, between the
inverses of the longest and the shortest, the one-sided density S(f) = A^2 / f with variance A^2 ln q of each
state. A state is drawn anew only once an eighth of its time constant has passed, so slow ones cost nothing.
Source: P. Dutta, P. M. Horn, Rev. Mod. Phys. 53, 497 (1981): 1/f from a spread of relaxation times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter

RATIO: Final = 4.0
"""Of neighbouring time constants; the ripple of the density is then below 2 %."""
_REFRESH: Final = 0.125


@dataclass(frozen=True, slots=True, kw_only=True)
class Flicker(Effect):
    """1/f noise of every tactel, independent of all others."""

    name = "flicker"
    stage = Stage.TACTEL
    # assumed: at 1 Hz as strong as 200 Pa of white noise sampled at 50 Hz is there, 200 / sqrt(25)
    pa_at_1hz: Annotated[float, parameter("Pa/sqrt(Hz)", "amplitude density at 1 Hz", ge=0)] = 40.0
    low_hz: Annotated[float, parameter("Hz", "flat below this frequency", gt=0)] = 0.01
    high_hz: Annotated[float, parameter("Hz", "falls faster above this frequency", gt=0)] = 50.0

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        longest, shortest = 1.0 / (math.tau * self.low_hz), 1.0 / (math.tau * self.high_hz)
        n = max(1, 1 + round(math.log(max(longest / shortest, 1.0)) / math.log(RATIO)))
        taus = (longest / RATIO ** np.arange(n)).tolist()
        sigma = self.pa_at_1hz * math.sqrt(math.log(RATIO))
        states = sigma * rng.standard_normal((n, arm.n_tactels))
        total = states.sum(axis=0)
        drawn = [math.nan] * n

        def step(pressures: Floats, t_s: float) -> None:
            changed = False
            for k, tau in enumerate(taus):
                if not t_s >= drawn[k]:  # the first sample, or a scene that begins anew
                    drawn[k] = t_s
                elif t_s - drawn[k] >= _REFRESH * tau:
                    keep = math.exp(-(t_s - drawn[k]) / tau)
                    states[k] *= keep
                    states[k] += sigma * math.sqrt(1.0 - keep * keep) * rng.standard_normal(arm.n_tactels)
                    drawn[k] = t_s
                    changed = True
            if changed:
                np.sum(states, axis=0, out=total)
            pressures += total

        return step
