"""Response: each tactel responds in its own way, fixed for the run.

gain, width and ellipse change how a tactel responds to a load, ``residual`` is what no such number describes:
a smooth random function of the place of the load, with a profile over distance that is largest where the load
is beside the tactel. ``offset_pa`` is what it reads of no load. Zero strength of each leaves the layer's
own table.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Stage, parameter, settings
from skinbus.sim.layer import Geometry, ResponseColumns

PROFILE: Final = np.array(
    [[0.0, 1e-3, 5e-3, 8e-3, 12e-3, 20e-3, 30e-3], [0.0, 0.04, 0.22, 1.0, 0.65, 0.22, 0.0]]
)
"""Distance (m) and standard deviation of the residual as a share of its largest: measured on an array of
barometers under rubber, 9.9 mm apart; the ends are zero."""
N_WAVES: Final = 24
"""Cosines that make up the smooth function: its values are then normal within a few per cent."""


@settings
class Response(Effect):
    """Differences between tactels; the defaults are those of a real array of barometers under rubber."""

    stage = Stage.GEOMETRY
    # gains of that array differ by 6 to 11 %, widths by 3 to 5 %, ellipses have ratios up to 1.07, offsets
    # are 0.1 to 0.3 % of the peak of a firm press (100 kPa), and the residual is 0.9 % of the peak at 8 mm
    gain: float = parameter(0.10, "", "standard deviation of the gain about 1", ge=0, le=0.3)
    width: float = parameter(0.04, "", "standard deviation of the width about 1", ge=0, le=0.1)
    ellipse: float = parameter(1.03, "", "ratio of the axes of the response", ge=1, le=1.2)
    offset_pa: float = parameter(200.0, "Pa", "standard deviation of the reading of no load", ge=0)
    residual: float = parameter(0.009, "", "largest residual, as a share of the peak", ge=0, le=0.2)
    correlation_mm: float = parameter(8.0, "mm", "length over which it changes", gt=0, le=100)

    def bind(self, arm: Arm, rng: np.random.Generator) -> Callable[[Geometry], None]:
        """Return ``step(geometry)``, which sets the responses of all tactels."""
        n = arm.n_tactels
        gain = 1.0 + self.gain * rng.standard_normal(n)
        width = np.maximum(1.0 + self.width * rng.standard_normal(n), 0.5)
        angle = rng.uniform(0.0, np.pi, n)
        offset = self.offset_pa * rng.standard_normal(n)
        # a Gaussian correlation exp(-x^2 / (2 L^2)) has normal wave numbers of deviation 1 / L
        waves = np.empty((n, N_WAVES, 3))
        waves[..., :2] = rng.standard_normal((n, N_WAVES, 2)) / (1e-3 * self.correlation_mm)
        waves[..., 2] = rng.uniform(0.0, 2.0 * np.pi, (n, N_WAVES))
        cos, sin, long = np.cos(angle), np.sin(angle), np.sqrt(self.ellipse)
        first, second = 1.0 / (width * long), long / width
        shape = np.empty((n, 2, 2))
        shape[:, 0, 0] = first * cos**2 + second * sin**2
        shape[:, 1, 1] = first * sin**2 + second * cos**2
        shape[:, 0, 1] = shape[:, 1, 0] = (first - second) * cos * sin
        acts = self.gain > 0.0 or self.width > 0.0 or self.ellipse > 1.0 or self.residual > 0.0

        def step(geometry: Geometry) -> None:
            if self.offset_pa > 0.0:
                geometry.offset = offset
            if acts:
                geometry.response = ResponseColumns(
                    gain=gain,
                    shape=shape,
                    waves=waves if self.residual > 0.0 else waves[:, :0].copy(),
                    residual=PROFILE * [[1.0], [self.residual]],
                )

        return step
