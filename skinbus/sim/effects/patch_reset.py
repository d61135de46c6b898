"""Patch reset: a board browns out, starts again and says so with its boot-up message."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.can.frame import Frame
from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.objects.cia import NMT_COMMAND_ID, NmtCommand
from skinbus.sim.effect import Effect, FrameStep, Stage, parameter, unknown_nodes


@dataclass(frozen=True, slots=True, kw_only=True)
class PatchReset(Effect):
    """Named boards at named times, and all boards at random."""

    name = "patch_reset"
    stage = Stage.FRAMES
    resets: Annotated[tuple[tuple[int, float], ...], parameter("", "[node-ID, scene time in s] pairs")] = ()
    # assumed: loose contacts in a moving arm
    per_hour: Annotated[float, parameter("1/h", "mean number of resets of every board", ge=0)] = 1.0

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for node-IDs that the arm does not have."""
        return unknown_nodes(arm, "resets", [node_id for node_id, _ in self.resets])

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that resets boards."""
        return _Step(self, arm, rng)


class _Step(FrameStep):
    def __init__(self, effect: PatchReset, arm: Arm, rng: np.random.Generator) -> None:
        self._named = sorted((t_s, node_id) for node_id, t_s in effect.resets)
        self._node_id = arm.node_id
        self._mean_s = 3600.0 / effect.per_hour if effect.per_hour else np.inf
        self._rng = rng
        gaps = rng.standard_exponential(arm.n_patches)
        self._next_s = self._mean_s * gaps if effect.per_hour else np.full(arm.n_patches, np.inf)
        self.next_s = float(self._next_s.min())

    def receive(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        while self._named and self._named[0][0] <= t_s:
            frames.insert(0, _reset(self._named.pop(0)[1], now_ns))
        while self.next_s <= t_s:
            patch = int(self._next_s.argmin())
            frames.insert(0, _reset(int(self._node_id[patch]), now_ns))
            self._next_s[patch] += self._mean_s * self._rng.standard_exponential()
            self.next_s = float(self._next_s.min())


def _reset(node_id: int, now_ns: int) -> Frame:
    """Return what makes one node start again; only the simulated nodes receive it."""
    return Frame(NMT_COMMAND_ID, bytes([NmtCommand.RESET_NODE, node_id]), now_ns)
