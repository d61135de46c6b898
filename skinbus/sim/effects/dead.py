"""Dead tactels: an open line reads no pressure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.sim.effect import (
    Effect,
    Floats,
    PressureStep,
    Stage,
    choose_tactels,
    parameter,
    unknown_tactels,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Dead(Effect):
    """Tactels that read nothing from a time on; the noise of the electronics stays."""

    name = "dead"
    stage = Stage.TACTEL
    tactels: Annotated[
        tuple[tuple[int, int], ...], parameter("", "[node-ID, tactel] pairs; tactels count from 1")
    ] = ()
    # assumed: one tactel in fifty, so that an arm shows some
    share: Annotated[float, parameter("", "probability of every tactel to be dead", ge=0, le=1)] = 0.02
    from_s: Annotated[float, parameter("s", "scene time at which they die", ge=0)] = 0.0

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for tactels that the arm does not have."""
        return unknown_tactels(arm, "tactels", self.tactels)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        chosen = choose_tactels(arm, self.tactels, self.share, rng)

        def step(pressures: Floats, t_s: float) -> None:
            if t_s >= self.from_s:
                pressures[chosen] = 0.0

        return step
