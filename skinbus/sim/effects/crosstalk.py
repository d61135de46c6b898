"""Crosstalk: in a scanned matrix a tactel reads a little of the others in its row and in its column."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, Ints, PressureStep, Stage, parameter, settings


@settings
class Crosstalk(Effect):
    """Adds a share of each other tactel in the same row and in the same column of the board."""

    stage = Stage.TACTEL
    # from below 3.3 % (fabric skin, arXiv 2508.20959) to 30 % of a reading in a 4 x 4 array without
    # countermeasures (Improving Accuracy in the Readout of Resistive Sensor Arrays, section 1)
    row: float = parameter(0.01, "", "share of each other tactel of the row", ge=0, le=1)
    column: float = parameter(0.01, "", "share of each other tactel of the column", ge=0, le=1)

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s) -> pressures``."""
        rows, columns = lines_of(arm)
        own = 1.0 - self.row - self.column

        def step(pressures: Floats, t_s: float) -> Any:
            along, across = (np.bincount(lines, pressures)[lines] for lines in (rows, columns))
            return own * pressures + self.row * along + self.column * across

        return step


def lines_of(arm: Arm) -> Ints:
    """Return the numbers of row and column of each tactel, (2, n_tactels); no two boards share one."""
    lines = np.zeros((2, arm.n_tactels), np.int32)
    for p, placed in enumerate(arm.patches):
        for k, um in enumerate(np.rint(1e6 * placed.patch.tactels_uv.T[::-1])):
            _, numbers = np.unique(um, return_inverse=True)
            lines[k, arm.tactels_of(p)] = arm.patch_start[p] + numbers
    return lines
