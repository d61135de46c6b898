"""Piezoresistive response: conductance grows with force, and a circuit turns it into a voltage.

An inverting amplifier is proportional to the conductance. A divider with a load resistor is not: with k the
load resistor over the tactel's resistance at full scale, and the reading scaled to be right at full scale,

    y = p (1 + k) / (1 + k p / full scale).

On top, each tactel bends by its own share of ``linearity``: 4 l x (1 - x) of full scale at x = p / full
scale. Source: Tekscan FlexiForce integration guide (inverting amplifier); D. Fraden, Handbook of Modern
Sensors, 6.2.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter, settings


@settings
class Piezoresistive(Effect):
    """The curve of tactel and circuit, right at zero and at full scale."""

    stage = Stage.TACTEL
    circuit: Literal["divider", "inverting"] = parameter("divider", "", "what turns conductance into voltage")
    load_ratio: float = parameter(0.3, "", "load resistor over resistance at full scale; divider", ge=0)
    # FlexiForce A201 datasheet and user manual rev. G, p. 13: linear within +-3 % of full scale
    linearity: float = parameter(0.03, "", "largest bend, as a share of full scale", ge=0, le=0.2)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        ratio = self.load_ratio if self.circuit == "divider" else 0.0
        bend = 4.0 * self.linearity * rng.uniform(-1.0, 1.0, arm.n_tactels)
        full_scale = np.array([placed.patch.transducer.full_scale for placed in arm.patches])[
            arm.tactel_patch
        ]

        def step(pressures: Floats, t_s: float) -> Any:
            x = np.clip(pressures / full_scale, 0.0, 1.0)
            return pressures * ((1.0 + ratio) / (1.0 + ratio * x)) + bend * x * (1.0 - x) * full_scale

        return step
