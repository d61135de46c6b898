"""Response jitter: nodes take their time between SYNC and their TPDOs."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from skinbus.can.frame import Frame
from skinbus.model import Arm
from skinbus.sim.effect import DrawsById, Effect, FrameStep, Stage, at, node_of, parameter, settings


@settings
class ResponseJitter(Effect):
    """Whatever a node says at one time is late together, by the size of a normally distributed number."""

    stage = Stage.FRAMES
    # assumed: firmware that serves SYNC from a task of 1 kHz, not from its interrupt
    sigma_us: float = parameter(300.0, "us", "root mean square of the lateness", ge=0)

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that makes frames late."""
        return _Step(self, arm, DrawsById(rng))


class _Step(FrameStep):
    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        late: dict[int, int] = {}
        for i, frame in enumerate(frames):
            node_id = node_of(frame)
            if node_id not in late:
                share = next(self.rng[frame.can_id])
                late[node_id] = round(1e3 * self.effect.sigma_us * NormalDist().inv_cdf(0.5 + 0.5 * share))
            frames[i] = at(frame, frame.t_ns + late[node_id])
