"""Settings of the layer laws; a law's module is imported when a scene's layer is bound."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from skinbus.sim.effect import parameter, settings
from skinbus.sim.indenter import Indenter
from skinbus.sim.layer import Floats, Geometry, Law

Indenters = Sequence[Indenter] | Floats


class LayerSettings:
    """What a scene says of the layer between the touches and the tactels."""

    __slots__ = ()
    law: ClassVar[str]

    @property
    def discs(self) -> bool:
        """Whether tactels average over their disc unless an effect says otherwise."""
        return False

    def bind(self, geometry: Geometry, indenters: Indenters) -> Law:
        """Return the law on a geometry, for these indenters or for discs of these radii (m)."""
        raise NotImplementedError


@settings
class Elastic(LayerSettings):
    """A rubber sheet bonded to the board: a finite elastic layer on a rigid base."""

    law = "elastic"
    # the layer of the shipped law (docs/estimator.md)
    thickness_mm: float = parameter(6.0, "mm", "thickness of the layer", gt=0, le=100)
    poisson: float = parameter(0.48, "", "Poisson ratio; silicone is nearly incompressible", ge=0, lt=0.5)
    depth_mm: float | None = parameter(None, "mm", "depth of the tactels; the base if not given", gt=0)
    tactel: Literal["disc", "point"] = parameter(
        "disc", "", "tactels average over their disc, or sample a point"
    )

    @property
    def discs(self) -> bool:
        """Whether tactels average over their disc unless an effect says otherwise."""
        return self.tactel == "disc"

    def bind(self, geometry: Geometry, indenters: Indenters) -> Law:
        """Return the law on a geometry, for these indenters or for discs of these radii (m)."""
        from skinbus.sim.layer_elastic import ElasticLaw

        thickness = 1e-3 * self.thickness_mm
        depth = thickness if self.depth_mm is None else min(1e-3 * self.depth_mm, thickness)
        return ElasticLaw(geometry, indenters, thickness=thickness, poisson=self.poisson, depth=depth)


@settings
class ConeSettings(LayerSettings):
    """The paper's cone, eq. 5-10."""

    law = "cone"
    slope_pa_per_m: float | None = parameter(
        None, "Pa/m", "fall of the pressure; what the boards say if not given", gt=0
    )

    def bind(self, geometry: Geometry, indenters: Indenters) -> Law:
        """Return the law on a geometry, for these indenters or for discs of these radii (m)."""
        from skinbus.sim.layer_cone import ConeLaw

        return ConeLaw(geometry, slope=self.slope_pa_per_m)


LAWS: dict[str, type[LayerSettings]] = {cls.law: cls for cls in (Elastic, ConeSettings)}
