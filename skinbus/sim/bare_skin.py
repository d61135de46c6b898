"""Touches that no tactel is near enough to show, by the law of the boards."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from skinbus.model import Arm
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch

_LOOKS: Final = 100
"""Times of a touch that are looked at."""


class BareTouch(NamedTuple):
    """A touch that is on bare skin, for a part of its time at least."""

    number: int
    """From 1, as in the file."""
    force: float
    """The largest, N."""
    share: float
    """Part of its time."""
    nearest: float
    """Least distance of a tactel there from what presses, m; infinite on a link without boards."""


def bare_touches(scene: Scene) -> list[BareTouch]:
    """Return the touches under whose largest force no tactel reads its threshold somewhere on their path."""
    found = [_bare(scene.arm, touch, number) for number, touch in enumerate(scene.touches, 1)]
    return [touch for touch in found if touch.share > 0.0 and touch.force > 0.0]


def _bare(arm: Arm, touch: Touch, number: int) -> BareTouch:
    force = float(touch.force[:, 1].max())
    s, a, _ = np.transpose([touch.at(t_s) for t_s in np.linspace(touch.start, touch.end, _LOOKS)])
    is_bare, nearest = np.ones(_LOOKS, np.bool_), np.full(_LOOKS, math.inf)
    for p, placed in enumerate(arm.patches):
        tactels = np.arange(arm.n_tactels)[arm.tactels_of(p)]
        tactels = tactels[arm.tactel_healthy[tactels]]
        if placed.link == touch.link and len(tactels):
            reach = 0.5 * math.hypot(touch.length, touch.width)
            d = np.maximum(arm.distance(tactels, s, a) / arm.tactel_width[tactels] - reach, 0.0)
            pressure = placed.patch.law.pressure(d, force)
            is_bare &= (pressure < arm.tactel_threshold[tactels]).all(axis=1)
            nearest = np.minimum(nearest, d.min(axis=1))
    return BareTouch(number, force, float(is_bare.mean()), float(nearest[is_bare].min(initial=math.inf)))
