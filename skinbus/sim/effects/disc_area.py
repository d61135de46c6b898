"""Disc area: a tactel reads the mean pressure over its active disc."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Stage, parameter
from skinbus.sim.layer import Geometry


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscArea(Effect):
    """Sets the diameter of all tactels; without it the elastic layer has the boards', the cone points."""

    name = "disc_area"
    stage = Stage.GEOMETRY
    # FlexiForce A201: sensing area of 9.53 mm (0.375 in) diameter; the paper, section II
    diameter_mm: Annotated[float, parameter("mm", "active diameter; 0 samples at a point", ge=0, le=50)] = (
        9.53
    )

    def bind(self, arm: Arm, rng: np.random.Generator) -> Callable[[Geometry], None]:
        """Return ``step(geometry)``, which sets the diameters."""

        def step(geometry: Geometry) -> None:
            geometry.diameter[:] = 1e-3 * self.diameter_mm

        return step
