"""Corrupt: frames of a wrong length or with a wrong bit, as faulty firmware sends them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.can.frame import Frame
from skinbus.model import Arm
from skinbus.sim.effect import DrawsById, Effect, FrameStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Corrupt(Effect):
    """Each frame is spoilt with the same probability: cut short, or one bit of its data turned."""

    name = "corrupt"
    stage = Stage.FRAMES
    # assumed; damage on the wire is caught by CAN's checksum, so what is left is wrong before it is sent
    probability: Annotated[float, parameter("", "of a frame to be spoilt", ge=0, le=1)] = 0.001
    length_share: Annotated[
        float, parameter("", "of those, cut short; the others lose a bit", ge=0, le=1)
    ] = 0.5

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that spoils frames."""
        return _Step(self, DrawsById(rng))


class _Step(FrameStep):
    def __init__(self, effect: Corrupt, draws: DrawsById) -> None:
        self._effect = effect
        self._draws = draws

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        p, draws = self._effect.probability, self._draws
        for i, frame in enumerate(frames):
            numbers = draws[frame[0]]
            if next(numbers) >= p or not frame.data:
                continue
            data = bytearray(frame.data)
            if next(numbers) < self._effect.length_share:
                del data[int(len(data) * next(numbers)) :]
            else:
                bit = int(8 * len(data) * next(numbers))
                data[bit // 8] ^= 1 << bit % 8
            frames[i] = frame._replace(data=bytes(data))
