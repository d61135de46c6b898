"""Hysteresis: a tactel reads less while the load grows than while it falls.

A play operator whose width grows with the load: the reading stays where it is until the load has moved by the
width, then follows at the edge. It does not depend on the rate, and closes at zero load.

    y <- min(max(y, p - w |p|), p + w |p|),   w = loop / 2

Source: A. Visintin, Differential Models of Hysteresis, 1994, III (play).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.jit import kernel
from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Hysteresis(Effect):
    """Play about the pressure, in proportion to it."""

    name = "hysteresis"
    stage = Stage.LAYER
    # FlexiForce A201 datasheet: hysteresis < 4.5 % of full scale, conditioned, at 80 % of full force
    loop: Annotated[float, parameter("", "width of the loop, as a share of the pressure", ge=0, lt=1)] = 0.045

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        state, half = np.zeros(arm.n_tactels), 0.5 * self.loop

        def step(pressures: Floats, t_s: float) -> None:
            _play(pressures, state, half)

        return step


@kernel
def _play(pressures: Floats, state: Floats, half: float) -> None:
    for i in range(len(pressures)):
        p = pressures[i]
        w = half * abs(p)
        state[i] = min(max(state[i], p - w), p + w)
        pressures[i] = state[i]
