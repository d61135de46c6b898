"""Babbling node: a faulty controller fills the bus with frames nobody asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.model import Arm
from skinbus.sim.effect import Effect, FrameStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class BabblingNode(Effect):
    """Frames of eight random bytes at a constant rate."""

    name = "babbling_node"
    stage = Stage.FRAMES
    # an identifier that CiA 301 restricts (table 41), below every PDO: the babbler wins each arbitration
    can_id: Annotated[int, parameter("", "identifier of the frames", ge=0, le=0x7FF)] = 0x010
    # assumed: some 13 % of 1 Mbit/s
    rate_hz: Annotated[float, parameter("Hz", "frames per second", ge=0, le=8000)] = 1000.0
    from_s: Annotated[float, parameter("s", "scene time of the first", ge=0)] = 0.0
    to_s: Annotated[float | None, parameter("s", "scene time of the last; never if not given", gt=0)] = None

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that adds the frames."""
        return _Step(self, rng)


class _Step(FrameStep):
    def __init__(self, effect: BabblingNode, rng: np.random.Generator) -> None:
        self._effect = effect
        self._rng = rng
        self._period_ns = round(1e9 / effect.rate_hz) if effect.rate_hz else NEVER
        self._next_ns = NEVER

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        effect = self._effect
        self.wake_ns = NEVER
        if not effect.rate_hz or t_s < effect.from_s or (effect.to_s is not None and t_s >= effect.to_s):
            self._next_ns = NEVER
            return
        if self._next_ns == NEVER:
            self._next_ns = now_ns
        while self._next_ns <= now_ns:
            frames.append(Frame(effect.can_id, self._rng.bytes(8), now_ns))
            self._next_ns += self._period_ns
        self.wake_ns = self._next_ns
