"""Stuck tactels: a reading freezes at what it was, noise and all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.sim.effect import (
    CountStep,
    Effect,
    Ints,
    Stage,
    choose_tactels,
    parameter,
    settings,
    unknown_tactels,
)


@settings
class Stuck(Effect):
    """Tactels that repeat one reading from a time on, as converters and their firmware do when they hang."""

    stage = Stage.COUNTS
    tactels: tuple[tuple[int, int], ...] = parameter((), "", "[node-ID, tactel] pairs; tactels count from 1")
    # assumed: one tactel in fifty, so that an arm shows some; that it happens: iCub support #1318, #1456
    share: float = parameter(0.02, "", "probability of every tactel to hang", ge=0, le=1)
    from_s: float = parameter(0.0, "s", "scene time at which they hang", ge=0)

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for tactels that the arm does not have."""
        return unknown_tactels(arm, "tactels", self.tactels)

    def bind(self, arm: Arm, rng: np.random.Generator) -> CountStep:
        """Return ``step(counts, t_s) -> counts``."""
        chosen = choose_tactels(arm, self.tactels, self.share, rng)
        frozen: Ints | None = None

        def step(counts: Ints, t_s: float) -> Ints:
            nonlocal frozen
            if t_s >= self.from_s:
                if frozen is None:
                    frozen = counts[chosen]
                counts[chosen] = frozen
            return counts

        return step
