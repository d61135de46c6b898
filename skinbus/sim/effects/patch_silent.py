"""Silent patches: boards that lose their plug, receive nothing and send nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinbus.can.frame import Frame
from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.sim.effect import Effect, FrameStep, Stage, parameter, reset, settings, unknown_nodes


@settings
class PatchSilent(Effect):
    """Boards that are gone from a time on; if they come back, they come back booting."""

    stage = Stage.FRAMES
    # by default nobody is silent: which boards fail, and when, is what a scene is about
    nodes: tuple[int, ...] = parameter((), "", "node-IDs of the boards")
    from_s: float = parameter(0.0, "s", "scene time at which they go", ge=0)
    to_s: float | None = parameter(None, "s", "scene time at which they are back; never if not given", gt=0)

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for node-IDs that the arm does not have, and for a return before the loss."""
        faults = unknown_nodes(arm, "nodes", self.nodes)
        if self.to_s is not None and self.to_s <= self.from_s:
            faults.append(Fault("to_s", self.to_s, f"later than from_s, {self.from_s:g}"))
        return faults

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that cuts the boards off."""
        return _Step(self, arm, rng)


class _Step(FrameStep):
    def receive(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        effect = self.effect
        if t_s >= effect.from_s and (effect.to_s is None or t_s < effect.to_s):
            self.deaf = frozenset(effect.nodes)
        elif self.deaf:
            frames[:0] = [reset(node_id, now_ns) for node_id in sorted(self.deaf)]
            self.deaf = frozenset()

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        self.silence(frames)
