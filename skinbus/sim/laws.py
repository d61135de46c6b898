"""The layers between touches and tactels that a scene may have: their settings, and the cone of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from skinbus.arrays import Floats
from skinbus.model.law import DEFAULT_LAW
from skinbus.sim.effect import parameter, settings
from skinbus.sim.indenter import Indenter
from skinbus.sim.layer import Geometry, Law, Loads


class LayerSettings:
    """What a scene says of the layer between the touches and the tactels."""

    __slots__ = ()
    law: ClassVar[str]
    discs: ClassVar[bool]
    """Whether tactels average over their disc; else they sample a point."""

    def bind(self, geometry: Geometry, indenters: Sequence[Indenter]) -> Law:
        """Return the law on a geometry, for these indenters."""
        raise NotImplementedError


@settings
class Elastic(LayerSettings):
    """A rubber sheet bonded to the board: a finite elastic layer on a rigid base."""

    law = "elastic"
    discs = True
    # the layer of the shipped law (docs/estimator.md)
    thickness_mm: float = parameter(6.0, "mm", "thickness of the layer", gt=0, le=100)
    poisson: float = parameter(0.48, "", "Poisson ratio; silicone is nearly incompressible", ge=0, lt=0.5)

    def bind(self, geometry: Geometry, indenters: Sequence[Indenter]) -> Law:
        """Return the law on a geometry, for these indenters."""
        from skinbus.sim.layer_elastic import ElasticLaw  # imported when a scene has it

        return ElasticLaw(geometry, indenters, thickness=1e-3 * self.thickness_mm, poisson=self.poisson)


@settings
class HalfSpace(LayerSettings):
    """A cover without a base under it: an elastic half-space after Boussinesq and Cerruti, tactels inside."""

    law = "half-space"
    discs = True
    depth_mm: float = parameter(6.0, "mm", "depth of the tactels", gt=0, le=100)

    def bind(self, geometry: Geometry, indenters: Sequence[Indenter]) -> Law:
        """Return the law on a geometry, for these indenters."""
        from skinbus.sim.layer_elastic import ElasticLaw

        return ElasticLaw(geometry, indenters, thickness=1e-3 * self.depth_mm, poisson=None)


@settings
class ConeSettings(LayerSettings):
    """The paper's cone, eq. 5-10, on point tactels: that of a board's law, or the default one.

    It is there to reproduce the paper; a scene's default is the elastic layer, so that the law that is fitted
    is not the one that was simulated.
    """

    law = "cone"
    discs = False

    def bind(self, geometry: Geometry, indenters: Sequence[Indenter]) -> Law:
        """Return the law on a geometry, whatever presses."""
        return ConeLaw(geometry)


class ConeLaw:
    """The cone bound to an arm; see ``model.law``."""

    def __init__(self, geometry: Geometry) -> None:
        self._geometry = geometry
        laws = [placed.patch.law for placed in geometry.arm.patches]
        slopes = [getattr(law, "slope", DEFAULT_LAW.slope) for law in laws]
        self._slope = np.array(slopes)[geometry.arm.tactel_patch]

    def add(self, loads: Loads, pressures: Floats) -> None:
        """Add the pressures of all loads, (n_tactels,) Pa."""
        for j in range(loads.n):
            tactels, x, y = self._geometry.ways(int(loads.link[j]), loads.s[j], loads.a[j])
            slope = self._slope[tactels]
            height = np.cbrt(3.0 * loads.force[j] * slope**2 / np.pi)
            pressures[tactels] += np.maximum(0.0, height - slope * np.hypot(x, y))


LAWS: dict[str, type[LayerSettings]] = {cls.law: cls for cls in (Elastic, HalfSpace, ConeSettings)}
