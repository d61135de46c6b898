"""Piezoresistive response: conductance grows with force, and a circuit turns it into a voltage.

An inverting amplifier is proportional to the conductance. A divider with a load resistor is not: with k the
load resistor over the tactel's resistance at full scale, and the reading scaled to be right at full scale,

    y = p (1 + k) / (1 + k p / full scale).

On top, each tactel bends by its own share of ``linearity``: 4 l x (1 - x) of full scale at x = p / full
scale. Source: Tekscan FlexiForce integration guide (inverting amplifier); D. Fraden, Handbook of Modern
Sensors, 6.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from skinbus.jit import kernel
from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Piezoresistive(Effect):
    """The curve of tactel and circuit, right at zero and at full scale."""

    name = "piezoresistive"
    stage = Stage.TACTEL
    circuit: Annotated[
        Literal["divider", "inverting"], parameter("", "what turns conductance into voltage")
    ] = "divider"
    load_ratio: Annotated[
        float, parameter("", "load resistor over resistance at full scale; divider", ge=0)
    ] = 0.3
    # FlexiForce A201 datasheet and user manual rev. G, p. 13: linear within +-3 % of full scale
    linearity: Annotated[float, parameter("", "largest bend, as a share of full scale", ge=0, le=0.2)] = 0.03

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        ratio = self.load_ratio if self.circuit == "divider" else 0.0
        bend = 4.0 * self.linearity * rng.uniform(-1.0, 1.0, arm.n_tactels)
        full = [placed.patch.transducer.full_scale for placed in arm.patches]
        full_scale = np.repeat(np.array(full), np.diff(arm.patch_start))

        def step(pressures: Floats, t_s: float) -> None:
            _respond(pressures, full_scale, ratio, bend)

        return step


@kernel
def _respond(pressures: Floats, full_scale: Floats, ratio: float, bend: Floats) -> None:
    for i in range(len(pressures)):
        p = pressures[i]
        x = min(max(p / full_scale[i], 0.0), 1.0)
        pressures[i] = p * ((1.0 + ratio) / (1.0 + ratio * x)) + bend[i] * x * (1.0 - x) * full_scale[i]
