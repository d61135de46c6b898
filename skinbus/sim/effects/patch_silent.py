"""Silent patches: boards that lose their plug, receive nothing and send nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.can.frame import Frame
from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.objects.cia import NMT_COMMAND_ID, NmtCommand
from skinbus.sim.effect import Effect, FrameStep, Stage, node_of, parameter, unknown_nodes


@dataclass(frozen=True, slots=True, kw_only=True)
class PatchSilent(Effect):
    """Boards that are gone from a time on; if they come back, they come back booting."""

    name = "patch_silent"
    stage = Stage.FRAMES
    # by default nobody is silent: which boards fail, and when, is what a scene is about
    nodes: Annotated[tuple[int, ...], parameter("", "node-IDs of the boards")] = ()
    from_s: Annotated[float, parameter("s", "scene time at which they go", ge=0)] = 0.0
    to_s: Annotated[
        float | None, parameter("s", "scene time at which they are back; never if not given", gt=0)
    ] = None

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for node-IDs that the arm does not have, and for a return before the loss."""
        faults = unknown_nodes(arm, "nodes", self.nodes)
        if self.to_s is not None and self.to_s <= self.from_s:
            faults.append(Fault("to_s", self.to_s, f"later than from_s, {self.from_s:g}"))
        return faults

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that cuts the boards off."""
        return _Step(self)


class _Step(FrameStep):
    def __init__(self, effect: PatchSilent) -> None:
        self._effect = effect
        self._nodes = frozenset(effect.nodes)

    def receive(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        effect = self._effect
        gone = t_s >= effect.from_s and (effect.to_s is None or t_s < effect.to_s)
        if gone:
            self.deaf = self._nodes
        elif self.deaf:
            self.deaf = frozenset()
            reset = NmtCommand.RESET_NODE
            frames[:0] = [Frame(NMT_COMMAND_ID, bytes([reset, n]), now_ns) for n in sorted(self._nodes)]

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        if self.deaf:
            frames[:] = [frame for frame in frames if node_of(frame) not in self.deaf]
