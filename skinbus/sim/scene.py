"""A scene: an arm, a layer, touches over time and only the effects that are named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from skinbus.model import Arm
from skinbus.sim.effect import ORDER, Effect
from skinbus.sim.laws import LayerSettings
from skinbus.sim.touch import Touch, Touches, TouchPlan

if TYPE_CHECKING:
    from skinbus.sim.joint_motion import JointMotion


BOOTED_S = 0.5
"""All patches have booted by then."""


@dataclass(eq=False)
class Scene:
    """What happens to an arm, from scene time 0 to ``duration_s``; fixed once made."""

    name: str
    arm: Arm
    _: KW_ONLY
    duration_s: float
    layer: LayerSettings
    seed: int = 0
    title: str = ""
    touches: Sequence[Touch] = ()
    effects: Sequence[Effect] = ()
    """In the order of physics, whatever the order in which they are given."""
    motion: JointMotion | None = None
    """How the joints of the robot move; None where nothing asks for it."""

    def __post_init__(self) -> None:
        self.effects = sorted(self.effects, key=lambda effect: ORDER.index(effect.name))

    @cached_property
    def plan(self) -> TouchPlan:
        """The touches compiled."""
        return TouchPlan(self.arm, self.touches)

    def touches_at(self, t_s: float) -> Touches:
        """Return the touches that press at a scene time (s): the truth."""
        return self.plan.at(t_s)

    @property
    def begins_untouched(self) -> bool:
        """Whether nothing presses when all patches have booted, so that their zeros can be taken then."""
        return not len(self.touches_at(BOOTED_S).touch)
