"""Settings of the layer laws; a law's module is imported when a scene's layer is bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict

from skinbus.sim.effect import parameter
from skinbus.sim.indenter import Indenter
from skinbus.sim.layer import Geometry, Law

Indenters = Sequence[Indenter] | npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerSettings:
    """What a scene says of the layer between the touches and the tactels."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
    law: ClassVar[str]

    @property
    def discs(self) -> bool:
        """Whether tactels average over their disc unless an effect says otherwise."""
        return False

    def bind(self, geometry: Geometry, indenters: Indenters) -> Law:
        """Return the law on a geometry, for these indenters or for discs of these radii (m)."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, kw_only=True)
class Elastic(LayerSettings):
    """A rubber sheet bonded to the board: a finite elastic layer on a rigid base."""

    law = "elastic"
    thickness_mm: Annotated[float, parameter("mm", "thickness of the layer", gt=0, le=100)] = (
        6.0  # the layer of the shipped law (docs/estimator.md)
    )
    poisson: Annotated[
        float, parameter("", "Poisson ratio; silicone is nearly incompressible", ge=0, lt=0.5)
    ] = 0.48
    depth_mm: Annotated[
        float | None, parameter("mm", "depth of the tactels; the base if not given", gt=0)
    ] = None
    tactel: Annotated[
        Literal["disc", "point"], parameter("", "tactels average over their disc, or sample a point")
    ] = "disc"

    @property
    def discs(self) -> bool:
        """Whether tactels average over their disc unless an effect says otherwise."""
        return self.tactel == "disc"

    def bind(self, geometry: Geometry, indenters: Indenters) -> Law:
        """Return the law on a geometry, for these indenters or for discs of these radii (m)."""
        thickness = 1e-3 * self.thickness_mm
        depth = thickness if self.depth_mm is None else min(1e-3 * self.depth_mm, thickness)
        law: Law = _module(self.law).ElasticLaw(
            geometry, indenters, thickness=thickness, poisson=self.poisson, depth=depth
        )
        return law


@dataclass(frozen=True, slots=True, kw_only=True)
class ConeSettings(LayerSettings):
    """The paper's cone, eq. 5-10."""

    law = "cone"
    slope_pa_per_m: Annotated[
        float | None, parameter("Pa/m", "fall of the pressure; what the boards say if not given", gt=0)
    ] = None

    def bind(self, geometry: Geometry, indenters: Indenters) -> Law:
        """Return the law on a geometry, for these indenters or for discs of these radii (m)."""
        law: Law = _module(self.law).ConeLaw(geometry, slope=self.slope_pa_per_m)
        return law


LAWS: dict[str, type[LayerSettings]] = {cls.law: cls for cls in (Elastic, ConeSettings)}


def _module(law: str) -> Any:
    return import_module(f"skinbus.sim.layer_{law}")
