"""Delay: gateways and busy controllers pass frames on late."""

from __future__ import annotations

import math

import numpy as np

from skinbus.can.frame import Frame
from skinbus.model import Arm
from skinbus.sim.effect import DrawsById, Effect, FrameStep, Stage, at, parameter, settings


@settings
class Delay(Effect):
    """Every frame is late by a constant and a random, exponentially distributed time."""

    stage = Stage.FRAMES
    # assumed: a CAN gateway that stores a frame and forwards it, some 130 us a frame, with a short queue
    constant_us: float = parameter(150.0, "us", "lateness of every frame", ge=0)
    mean_us: float = parameter(100.0, "us", "mean of the random part", ge=0)

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that makes frames late."""
        return _Step(self, arm, DrawsById(rng))


class _Step(FrameStep):
    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        constant_ns, mean_ns = 1e3 * self.effect.constant_us, 1e3 * self.effect.mean_us
        for i, frame in enumerate(frames):
            late_ns = constant_ns - mean_ns * math.log1p(-next(self.rng[frame.can_id]))
            frames[i] = at(frame, frame.t_ns + int(late_ns))
