"""Loss: frames that never arrive, as when receive buffers overflow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.can.frame import Frame
from skinbus.model import Arm
from skinbus.sim.effect import DrawsById, Effect, FrameStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Loss(Effect):
    """Each frame of the patches is lost with the same probability."""

    name = "loss"
    stage = Stage.FRAMES
    # assumed; CAN itself repeats damaged frames, so what is lost is lost in controllers and drivers
    probability: Annotated[float, parameter("", "of a frame to be lost", ge=0, le=1)] = 0.001

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that takes frames out."""
        return _Step(self.probability, DrawsById(rng))


class _Step(FrameStep):
    def __init__(self, probability: float, draws: DrawsById) -> None:
        self._probability = probability
        self._draws = draws

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        p, draws = self._probability, self._draws
        frames[:] = [frame for frame in frames if next(draws[frame[0]]) >= p]
