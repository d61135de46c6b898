"""Cable: a contact in the cable opens now and then, and the boards behind it are cut off.

It opens after a SYNC: the boards still sample for it, and what they have to say is acknowledged by nobody.
They repeat it without end (ISO 11898-1: an acknowledgement error takes no error passive node off the bus),
receive nothing more, and their frames arrive when the contact closes: late. Where the supply goes through
the same cable and the contact is open for longer than the capacitors hold, the boards start again instead.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinbus.can.frame import Frame
from skinbus.errors import Fault
from skinbus.model import Arm
from skinbus.sim.effect import Effect, FrameStep, Stage, at, parameter, reset, settings, unknown_nodes


@settings
class Cable(Effect):
    """An intermittent contact between ``node`` and the board before it; all higher node-IDs are behind it."""

    stage = Stage.FRAMES
    node: int = parameter(1, "", "first board behind the contact; 0: no contact is bad", ge=0, le=127)
    # assumed: a worn connector in a moving joint; openings from a millisecond to some tenths of a second
    per_minute: float = parameter(6.0, "1/min", "mean number of openings", ge=0)
    open_ms: float = parameter(20.0, "ms", "median of the time it is open", gt=0)
    spread: float = parameter(1.0, "", "standard deviation of its logarithm", ge=0, le=5)
    # 100 uF hold a board of 50 mA from 5 V down to 3.5 V for 3 ms; a larger one for longer (assumed)
    hold_up_ms: float = parameter(50.0, "ms", "time that the supply holds", ge=0)

    def check(self, arm: Arm) -> Sequence[Fault]:
        """Return a fault for a node-ID that the arm does not have."""
        return unknown_nodes(arm, "node", [self.node]) if self.node else ()

    def bind(self, arm: Arm, rng: np.random.Generator) -> FrameStep:
        """Return the step that cuts the boards off."""
        return _Step(self, arm, rng)


class _Step(FrameStep):
    def __init__(self, effect: Cable, arm: Arm, rng: np.random.Generator) -> None:
        super().__init__(effect, arm, rng)
        self._behind = frozenset(int(n) for n in arm.node_id if effect.node and n >= effect.node)
        self._mean_s = 60.0 / effect.per_minute if effect.per_minute and self._behind else np.inf
        self._opens_s = self._mean_s * rng.standard_exponential() if self._behind else np.inf
        self._closes_s = np.inf
        self._kept: list[Frame] = []
        self._is_open = self._loses_supply = False

    def receive(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        if self._is_open and t_s >= self._closes_s:
            self._is_open = False
            self.deaf = frozenset()
            self._opens_s = self._closes_s + self._mean_s * self.rng.standard_exponential()
            if self._loses_supply:
                self._kept.clear()
                frames[:0] = [reset(node_id, now_ns) for node_id in sorted(self._behind)]
        if not self._is_open and t_s >= self._opens_s:
            open_s = 1e-3 * self.effect.open_ms * np.exp(self.effect.spread * self.rng.standard_normal())
            self._is_open = True
            self._closes_s = self._opens_s + open_s
            self._loses_supply = open_s > 1e-3 * self.effect.hold_up_ms

    def say(self, now_ns: int, t_s: float, frames: list[Frame]) -> None:
        if self._is_open:
            self.deaf = self._behind
            self._kept += self.silence(frames)
        elif self._kept:
            frames[:0] = [at(frame, now_ns) for frame in self._kept]
            self._kept.clear()
