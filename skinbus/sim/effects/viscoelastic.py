"""Viscoelastic layer: a standard linear solid, so that pressure relaxes or a reading creeps.

The solid has modulus E0 at once and E0 (1 - R) in the end. Held in position, its pressure relaxes,

    p(t) = p0 (1 - R (1 - exp(-t / tau)));

held by a constant force, its strain, and with it what a film below reads, creeps,

    p(t) = p0 (1 + c (1 - exp(-t / tau_c))),   c = R / (1 - R),   tau_c = tau / (1 - R).

One first-order state per tactel, advanced exactly for a pressure that is constant over the step.
Source: W. N. Findley, J. S. Lai, K. Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials, 1976,
5.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, PressureStep, Stage, parameter, settings


@settings
class Viscoelastic(Effect):
    """Relaxation under held position, or creep under held force."""

    stage = Stage.LAYER
    # assumed: soft silicones (Ecoflex, Sylgard) do relax (doi 10.1089/soro.2015.0002), filled ones more than
    # others
    relaxation: float = parameter(0.1, "", "share of the modulus that relaxes", ge=0, lt=1)
    tau_s: float = parameter(1.0, "s", "time constant of the relaxation", gt=0)
    control: Literal["force", "position"] = parameter(
        "force", "", "what a touch holds: its force, or its position"
    )

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        if self.control == "force":
            gain, tau = self.relaxation / (1.0 - self.relaxation), self.tau_s / (1.0 - self.relaxation)
        else:
            gain, tau = -self.relaxation, self.tau_s
        state, last = np.zeros(arm.n_tactels), math.nan

        def step(pressures: Floats, t_s: float) -> Floats:
            nonlocal last
            elapsed, last = max(0.0, t_s - last) if last == last else 0.0, t_s
            state[:] -= math.expm1(-elapsed / tau) * (pressures - state)
            return pressures + gain * state

        return step
