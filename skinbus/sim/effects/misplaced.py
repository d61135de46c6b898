"""Misplaced patches: boards do not sit exactly where the arm file says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Stage, parameter, settings
from skinbus.sim.layer import Geometry


@settings
class Misplaced(Effect):
    """Each patch is shifted along both directions of the surface and turned about its centre."""

    stage = Stage.GEOMETRY
    # poses of skin units found by touch or from accelerometers err by 1 to 2 mm (arXiv 2412.00672; notes of
    # Stepanova et al. on 50 to 100 poses)
    sigma_mm: float = parameter(1.0, "mm", "standard deviation of each shift", ge=0, le=50)
    sigma_deg: float = parameter(1.0, "deg", "standard deviation of the turn", ge=0, le=45)

    def bind(self, arm: Arm, rng: np.random.Generator) -> Callable[[Geometry], None]:
        """Return ``step(geometry)``, which moves the tactels."""
        ds, da = 1e-3 * self.sigma_mm * rng.standard_normal((2, arm.n_patches))
        turn = np.radians(self.sigma_deg) * rng.standard_normal(arm.n_patches)

        def step(geometry: Geometry) -> None:
            for p, placed in enumerate(arm.patches):
                if not (ds[p] or da[p] or turn[p]):
                    continue
                surface, at = arm.links[placed.link].surface, arm.tactels_of(p)
                # on the flat development about the patch's own centre
                x, y = surface.develop(geometry.s[at], geometry.a[at], placed.a)
                x = x - placed.s
                cos, sin = np.cos(turn[p]), np.sin(turn[p])
                moved = surface.undevelop(
                    placed.s + cos * x - sin * y + ds[p], sin * x + cos * y + da[p], placed.a
                )
                geometry.s[at], geometry.a[at] = moved

        return step
