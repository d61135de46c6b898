"""Disc area: a tactel reads the mean pressure over its active disc."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Stage, parameter, settings
from skinbus.sim.layer import Geometry


@settings
class DiscArea(Effect):
    """Sets the diameter of all tactels; without it the elastic layer has the boards', the cone points."""

    stage = Stage.GEOMETRY
    # FlexiForce A201: sensing area of 9.53 mm (0.375 in) diameter; the paper, section II
    diameter_mm: float = parameter(9.53, "mm", "active diameter; 0 samples at a point", ge=0, le=50)

    def bind(self, arm: Arm, rng: np.random.Generator) -> Callable[[Geometry], None]:
        """Return ``step(geometry)``, which sets the diameters."""
        return lambda geometry: geometry.diameter.fill(1e-3 * self.diameter_mm)
