"""Loss: frames that never arrive, as when receive buffers overflow."""

from __future__ import annotations

import numpy as np

from skinbus.can.frame import Frame
from skinbus.model import Arm
from skinbus.sim.effect import DrawsById, Effect, FrameStep, Stage, parameter, settings


@settings
class Loss(Effect):
    """Each frame of the patches is lost with the same probability."""

    stage = Stage.FRAMES
    # assumed; CAN itself repeats damaged frames, so what is lost is lost in controllers and drivers
    probability: float = parameter(0.001, "", "of a frame to be lost", ge=0, le=1)

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that takes frames out."""
        return _Step(self, arm, DrawsById(rng))


class _Step(FrameStep):
    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        p = self.effect.probability
        frames[:] = [frame for frame in frames if next(self.rng[frame.can_id]) >= p]
