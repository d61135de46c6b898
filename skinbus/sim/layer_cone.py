"""The paper's cone as a layer law: pressure falls linearly with the distance from the load, to zero.

It is there to reproduce the paper; a scene's default is the elastic layer, so that the law that is fitted is
not the one that was simulated. Tactels are points unless a scene names their disc; then the cone is averaged
over it by a cubature of 36 points (rings of equal area).

Source: the paper, eq. 5-10; see ``model.law.Cone``.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from skinbus.model.law import Cone
from skinbus.sim.layer import Floats, Geometry, Loads

_RINGS: Final = 6
_SPOKES: Final = 6


class ConeLaw:
    """The cone bound to an arm; ``slope`` (Pa/m) for all patches, or None for what each board's law says."""

    def __init__(self, geometry: Geometry, *, slope: float | None = None) -> None:
        self._geometry = geometry
        laws = [placed.patch.law for placed in geometry.arm.patches]
        own = [law.slope if isinstance(law, Cone) else Cone().slope for law in laws]
        self._slope = np.array(own if slope is None else [slope] * len(own))[geometry.arm.tactel_patch]
        # points that average over a disc: at the middles of rings of equal area, turned against each other
        ring = np.sqrt((np.arange(_RINGS)[:, None] + 0.5) / _RINGS)
        turned = np.arange(_SPOKES) + np.arange(_RINGS)[:, None] / _RINGS + 0.125
        self._points = (ring * np.exp(2j * np.pi / _SPOKES * turned)).ravel()

    def add(self, loads: Loads, pressures: Floats) -> None:
        """Add the pressures of all loads, (n_tactels,) Pa."""
        for link, s, a, force in zip(
            *(c[: loads.n] for c in (loads.link, loads.s, loads.a, loads.force)), strict=True
        ):
            tactels, x, y = self._geometry.ways(link, s, a)
            slope, radius = self._slope[tactels], 0.5 * self._geometry.diameter[tactels]
            height = np.cbrt(3.0 * force * slope**2 / np.pi)
            within = np.flatnonzero(np.hypot(x, y) < height / slope + radius)
            away = np.hypot(x, y)[within, None]
            if radius.any():
                away = np.abs(away + radius[within, None] * self._points)
            cone = np.maximum(0.0, height[within, None] - slope[within, None] * away)
            pressures[tactels[within]] += cone.mean(axis=1)
