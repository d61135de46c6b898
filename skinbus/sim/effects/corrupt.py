"""Corrupt: frames of a wrong length or with a wrong bit, as faulty firmware sends them."""

from __future__ import annotations

import numpy as np

from skinbus.can.frame import Frame
from skinbus.model import Arm
from skinbus.sim.effect import DrawsById, Effect, FrameStep, Stage, parameter, settings


@settings
class Corrupt(Effect):
    """Each frame is spoilt with the same probability: cut short, or one bit of its data turned."""

    stage = Stage.FRAMES
    # assumed; damage on the wire is caught by CAN's checksum, so what is left is wrong before it is sent
    probability: float = parameter(0.001, "", "of a frame to be spoilt", ge=0, le=1)
    length_share: float = parameter(0.5, "", "of those, cut short; the others lose a bit", ge=0, le=1)

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that spoils frames."""
        return _Step(self, arm, DrawsById(rng))


class _Step(FrameStep):
    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        for i, frame in enumerate(frames):
            numbers = self.rng[frame.can_id]
            if next(numbers) >= self.effect.probability or not frame.data:
                continue
            data = bytearray(frame.data)
            if next(numbers) < self.effect.length_share:
                del data[int(len(data) * next(numbers)) :]
            else:
                bit = int(8 * len(data) * next(numbers))
                data[bit // 8] ^= 1 << bit % 8
            frames[i] = frame._replace(data=bytes(data))
