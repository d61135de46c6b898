"""Hysteresis: a tactel reads less while the load grows than while it falls.

A play operator whose width grows with the load: the reading stays where it is until the load has moved by the
width, then follows at the edge. It does not depend on the rate, and closes at zero load.

    y <- min(max(y, p - w |p|), p + w |p|),   w = loop / 2

Source: A. Visintin, Differential Models of Hysteresis, 1994, III (play).
"""

from __future__ import annotations

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter, settings


@settings
class Hysteresis(Effect):
    """Play about the pressure, in proportion to it."""

    stage = Stage.LAYER
    # FlexiForce A201 datasheet: hysteresis < 4.5 % of full scale, conditioned, at 80 % of full force
    loop: float = parameter(0.045, "", "width of the loop, as a share of the pressure", ge=0, lt=1)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        state = np.zeros(arm.n_tactels)

        def step(pressures: Floats, t_s: float) -> Floats:
            width = 0.5 * self.loop * np.abs(pressures)
            state[:] = np.clip(state, pressures - width, pressures + width)
            return state.copy()

        return step
