"""Thermal: boards warm up, and with them the zeros and the gains of their tactels, touched or not.

Each board's temperature goes from ``start_c`` to ``end_c`` with one time constant; boards differ in how far
it goes. A zero follows its board by a coefficient that all tactels have in common and a part of its own.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter, settings


@settings
class Thermal(Effect):
    """Temperatures of the boards, as differences from that of calibration, and what follows them."""

    stage = Stage.TACTEL
    # a robot arm's motors warm its skin by some 10 degrees within the first half hour (assumed)
    start_c: float = parameter(0.0, "K", "difference from calibration at scene time 0")
    end_c: float = parameter(10.0, "K", "difference from calibration in the end")
    tau_s: float = parameter(600.0, "s", "time constant of the warm-up; 0 is at once", ge=0)
    # near a motor or away from it (assumed)
    board_sigma_c: float = parameter(2.0, "K", "standard deviation between boards", ge=0)
    # gas enclosed over a barometer, p/T = 101 325 Pa / 293 K (Gay-Lussac), of which firmware that has the
    # temperature of its own converter leaves half (assumed)
    zero_pa_per_k: float = parameter(170.0, "Pa/K", "change of all zeros per degree")
    zero_sigma_pa_per_k: float = parameter(20.0, "Pa/K", "standard deviation of that between tactels", ge=0)
    # FlexiForce A201 datasheet: output changes by 0.36 % per degree C
    per_degree: float = parameter(0.0036, "1/K", "change of sensitivity per degree", ge=-0.1, le=0.1)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        further = (self.board_sigma_c * rng.standard_normal(arm.n_patches))[arm.tactel_patch]
        zero = self.zero_pa_per_k + self.zero_sigma_pa_per_k * rng.standard_normal(arm.n_tactels)

        def step(pressures: Floats, t_s: float) -> Any:
            left = math.exp(-max(t_s, 0.0) / self.tau_s) if self.tau_s > 0.0 else 0.0
            degrees = further * (1.0 - left) + (self.end_c + (self.start_c - self.end_c) * left)
            return pressures * (1.0 + self.per_degree * degrees) + zero * degrees

        return step
