"""Dead tactels: an open line reads no pressure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.sim.effect import (
    Effect,
    PressureStep,
    Stage,
    choose_tactels,
    parameter,
    settings,
    unknown_tactels,
)


@settings
class Dead(Effect):
    """Tactels that read nothing from a time on; the noise of the electronics stays."""

    stage = Stage.TACTEL
    tactels: tuple[tuple[int, int], ...] = parameter((), "", "[node-ID, tactel] pairs; tactels count from 1")
    # assumed: one tactel in fifty, so that an arm shows some
    share: float = parameter(0.02, "", "probability of every tactel to be dead", ge=0, le=1)
    from_s: float = parameter(0.0, "s", "scene time at which they die", ge=0)

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for tactels that the arm does not have."""
        return unknown_tactels(arm, "tactels", self.tactels)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        alive = np.ones(arm.n_tactels)
        alive[choose_tactels(arm, self.tactels, self.share, rng)] = 0.0
        return lambda pressures, t_s: pressures * alive if t_s >= self.from_s else pressures
