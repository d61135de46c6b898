"""Patch reset: a board browns out, starts again and says so with its boot-up message."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinbus.can.frame import Frame
from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.sim.effect import Effect, FrameStep, Stage, parameter, reset, settings, unknown_nodes


@settings
class PatchReset(Effect):
    """Named boards at named times, and all boards at random."""

    stage = Stage.FRAMES
    resets: tuple[tuple[int, float], ...] = parameter((), "", "[node-ID, scene time in s] pairs")
    # assumed: loose contacts in a moving arm
    per_hour: float = parameter(1.0, "1/h", "mean number of resets of every board", ge=0)

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for node-IDs that the arm does not have."""
        return unknown_nodes(arm, "resets", [node_id for node_id, _ in self.resets])

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that resets boards."""
        return _Step(self, arm, rng)


class _Step(FrameStep):
    def __init__(self, effect: PatchReset, arm: Arm, rng: np.random.Generator) -> None:
        super().__init__(effect, arm, rng)
        self._named = sorted((t_s, node_id) for node_id, t_s in effect.resets)
        self._mean_s = 3600.0 / effect.per_hour if effect.per_hour else np.inf
        self.next_s = self._mean_s * rng.standard_exponential(arm.n_patches)

    def receive(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        while self._named and self._named[0][0] <= t_s:
            frames.insert(0, reset(self._named.pop(0)[1], now_ns))
        while self.next_s.min() <= t_s:
            patch = int(self.next_s.argmin())
            frames.insert(0, reset(int(self.arm.node_id[patch]), now_ns))
            self.next_s[patch] += self._mean_s * self.rng.standard_exponential()
