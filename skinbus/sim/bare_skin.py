"""Touches that no tactel is near enough to show, by the law of the boards."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch

Floats = npt.NDArray[np.float64]

_LOOKS: Final = 100
"""Places on a path that are looked at."""


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
    found = []
    for number, touch in enumerate(scene.touches, 1):
        force = float(touch.force[:, 1].max())
        distance, pressure = _seen(scene.arm, touch, force)
        bare = ~(pressure >= 1.0).any(axis=1)
        if bare.any() and force > 0.0:
            nearest = float(distance[bare].min(initial=math.inf))
            found.append(BareTouch(number, force, float(bare.mean()), nearest))
    return found


def _half(touch: Touch) -> float:
    """Return how far what presses reaches from its centre, m."""
    return 0.5 * math.hypot(touch.length, touch.width)


def _places(touch: Touch) -> tuple[Floats, Floats]:
    """Return s and a (m) of the places of a touch that are looked at."""
    at = np.linspace(touch.start, touch.end, 1 if len(touch.path) == 1 else _LOOKS)
    s, a = (np.interp(at, touch.path[:, 0], touch.path[:, k]) for k in (1, 2))
    return s, a


def _healthy(arm: Arm, touch: Touch) -> npt.NDArray[np.intp]:
    """Return the tactels that may feel a touch."""
    return np.flatnonzero((arm.tactel_link == touch.link) & arm.tactel_healthy)


def _seen(arm: Arm, touch: Touch, force: float) -> tuple[Floats, Floats]:
    """Return distances (m) of the tactels of the link, and their pressures over their thresholds, (n, m)."""
    s, a = _places(touch)
    tactels = _healthy(arm, touch)
    if not len(tactels):
        return np.zeros((len(s), 0)), np.zeros((len(s), 0))
    distance = np.maximum(arm.distance(tactels, s, a) / arm.tactel_width[tactels] - _half(touch), 0.0)
    part = np.zeros_like(distance)
    for p in np.unique(arm.tactel_patch[tactels]):
        mine = arm.tactel_patch[tactels] == p
        law = arm.patches[p].patch.law
        part[:, mine] = law.pressure(distance[:, mine], force) / arm.tactel_threshold[tactels[mine]]
    return distance, part
