"""Babbling node: a faulty controller fills the bus with frames nobody asked for."""

from __future__ import annotations

import numpy as np

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.model import Arm
from skinbus.sim.effect import Effect, FrameStep, Stage, parameter, settings


@settings
class BabblingNode(Effect):
    """Frames of eight random bytes at a constant rate."""

    stage = Stage.FRAMES
    # an identifier that CiA 301 restricts (table 41), below every PDO: the babbler wins each arbitration
    can_id: int = parameter(0x010, "", "identifier of the frames", ge=0, le=0x7FF)
    # assumed: some 13 % of 1 Mbit/s
    rate_hz: float = parameter(1000.0, "Hz", "frames per second", ge=0, le=8000)
    from_s: float = parameter(0.0, "s", "scene time of the first", ge=0)
    to_s: float | None = parameter(None, "s", "scene time of the last; never if not given", gt=0)

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that adds the frames."""
        return _Step(self, arm, rng)


class _Step(FrameStep):
    _next_ns = NEVER

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        effect = self.effect
        if not effect.rate_hz or t_s < effect.from_s or (effect.to_s is not None and t_s >= effect.to_s):
            self._next_ns = self.wake_ns = NEVER
            return
        if self._next_ns == NEVER:
            self._next_ns = now_ns
        while self._next_ns <= now_ns:
            frames.append(Frame(effect.can_id, self.rng.bytes(8), now_ns))
            self._next_ns += round(1e9 / effect.rate_hz)
        self.wake_ns = self._next_ns
