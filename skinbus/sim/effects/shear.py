"""Shear: pushes are inclined as their touches say, as far as friction lets them.

A push whose tangential force is below ``friction`` times the normal force sticks and has that force; one
above slips and has ``friction`` times the normal force (Coulomb). The physics is in ``sim.layer_shear``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Stage, parameter, settings
from skinbus.sim.layer import Geometry


@settings
class Shear(Effect):
    """Lets the ``inclination`` of touches act; points, discs and spheres."""

    stage = Stage.GEOMETRY
    # dry skin on smooth polymers 0.3 to 1 (M. J. Adams et al., J. R. Soc. Interface 10, 20120467, 2013)
    friction: float = parameter(0.6, "", "coefficient between indenter and cover", ge=0, le=10)

    def bind(self, arm: Arm, rng: np.random.Generator) -> Callable[[Geometry], None]:
        """Return ``step(geometry)``, which sets the friction."""

        def step(geometry: Geometry) -> None:
            geometry.friction = self.friction

        return step
