"""Bend: the preload of a flat board strapped to a curved link.

A flat board touches a cylinder of radius r along one line and stands off by w^2 / (2 r) at distance w from it
around the link. What holds it down presses there, in proportion to the stand-off.
"""

from __future__ import annotations

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, PressureStep, Stage, parameter, settings


@settings
class Bend(Effect):
    """A constant pressure on the tactels that stand off a curved link; nothing on a plane."""

    stage = Stage.LAYER
    # assumed: a sleeve of 10 N over a board's edge, 1.7 mm off a forearm of 65 mm, gives some 1 kPa there
    kpa_per_mm: float = parameter(0.5, "kPa/mm", "pressure per stand-off from the link", ge=0)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``, which adds the preload."""
        preload = np.zeros(arm.n_tactels)
        for p, placed in enumerate(arm.patches):
            surface, at = arm.links[placed.link].surface, arm.tactels_of(p)
            if surface.period > 0.0:
                radius = surface.radius_at(arm.tactel_s[at])
                around = surface.wrap(arm.tactel_a[at] - placed.a) * radius / surface.radius
                preload[at] = 1e6 * self.kpa_per_mm * around**2 / (2.0 * radius)
        return lambda pressures, t_s: pressures + preload
