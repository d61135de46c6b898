"""Delay: gateways and busy controllers pass frames on late."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.can.frame import Frame
from skinbus.model import Arm
from skinbus.sim.effect import DrawsById, Effect, FrameStep, Stage, at, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay(Effect):
    """Every frame is late by a constant and a random, exponentially distributed time."""

    name = "delay"
    stage = Stage.FRAMES
    # assumed: a CAN gateway that stores a frame and forwards it, some 130 us a frame, with a short queue
    constant_us: Annotated[float, parameter("us", "lateness of every frame", ge=0)] = 150.0
    mean_us: Annotated[float, parameter("us", "mean of the random part", ge=0)] = 100.0

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that makes frames late."""
        return _Step(1e3 * self.constant_us, 1e3 * self.mean_us, DrawsById(rng))


class _Step(FrameStep):
    def __init__(self, constant_ns: float, mean_ns: float, draws: DrawsById) -> None:
        self._constant_ns, self._mean_ns = constant_ns, mean_ns
        self._draws = draws

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        constant_ns, mean_ns, draws = self._constant_ns, self._mean_ns, self._draws
        for i, frame in enumerate(frames):
            late_ns = constant_ns - mean_ns * math.log1p(-next(draws[frame[0]]))
            frames[i] = at(frame, frame[2] + int(late_ns))
