"""Bus off: controllers that counted too many errors leave the bus, and are let back after a while."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from skinbus.can.frame import Frame
from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.objects.cia import EMCY_BASE, EmcyCode
from skinbus.sim.effect import Effect, FrameStep, Stage, parameter, settings, unknown_nodes

_REGISTER: Final = 0x11  # generic and communication error, CiA 301, 7.5.2.2


@settings
class BusOff(Effect):
    """Boards receive and send nothing for a while, keep running, and report it when they are back."""

    stage = Stage.FRAMES
    nodes: tuple[int, ...] = parameter((), "", "node-IDs of the boards")
    at_s: float = parameter(0.0, "s", "scene time at which they go off", ge=0)
    # ISO 11898-1 asks for 128 x 11 recessive bits, 1.4 ms; firmware waits longer so as not to come back at
    # once
    recovery_s: float = parameter(0.5, "s", "time off the bus", gt=0)

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return faults for node-IDs that the arm does not have."""
        return unknown_nodes(arm, "nodes", self.nodes)

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that cuts the boards off."""
        return _Step(self, arm, rng)


class _Step(FrameStep):
    _back: Sequence[int] = ()

    def receive(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        effect = self.effect
        if effect.at_s <= t_s < effect.at_s + effect.recovery_s:
            self.deaf = frozenset(effect.nodes)
        elif self.deaf:
            self._back, self.deaf = sorted(self.deaf), frozenset()

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        self.silence(frames)
        for node_id in self._back:
            code = int(EmcyCode.BUS_OFF_RECOVERED).to_bytes(2, "little")
            frames.append(Frame(EMCY_BASE + node_id, code + bytes([_REGISTER]) + bytes(5), now_ns))
        self._back = ()
