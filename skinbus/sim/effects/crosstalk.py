"""Crosstalk: in a scanned matrix a tactel reads a little of the others in its row and in its column."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from skinbus.jit import kernel
from skinbus.model import Arm
from skinbus.sim.effect import Effect, Floats, Ints, PressureStep, Stage, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Crosstalk(Effect):
    """Adds a share of each other tactel in the same row and in the same column of the board."""

    name = "crosstalk"
    stage = Stage.TACTEL
    # from below 3.3 % (fabric skin, arXiv 2508.20959) to 30 % of a reading in a 4 x 4 array without
    # countermeasures (Improving Accuracy in the Readout of Resistive Sensor Arrays, section 1)
    row: Annotated[float, parameter("", "share of each other tactel of the row", ge=0, le=1)] = 0.01
    column: Annotated[float, parameter("", "share of each other tactel of the column", ge=0, le=1)] = 0.01

    def bind(self, arm: Arm, rng: np.random.Generator) -> PressureStep:
        """Return ``step(pressures, t_s)``."""
        rows, columns = lines_of(arm)
        sums, along = np.zeros(max(rows.max(), columns.max()) + 1), np.zeros(arm.n_tactels)

        def step(pressures: Floats, t_s: float) -> None:
            _mix(pressures, rows, columns, sums, along, self.row, self.column)

        return step


def lines_of(arm: Arm) -> tuple[Ints, Ints]:
    """Return the numbers of row and column of each tactel, (n_tactels,); no two boards share one."""
    lines = np.zeros((2, arm.n_tactels), np.int32)
    first = np.zeros(2, np.int32)
    for p, placed in enumerate(arm.patches):
        micrometres = np.rint(1e6 * placed.patch.tactels_uv)
        for k, values in enumerate((micrometres[:, 1], micrometres[:, 0])):
            distinct, numbers = np.unique(values, return_inverse=True)
            lines[k, arm.tactels_of(p)] = first[k] + numbers
            first[k] += len(distinct)
    return lines[0], lines[1]


@kernel
def _mix(
    pressures: Floats, rows: Ints, columns: Ints, sums: Floats, along: Floats, row: float, column: float
) -> None:
    # both from the pressures as they came: y = p + row (R - p) + column (C - p)
    own = 1.0 - row - column
    for k in range(len(sums)):
        sums[k] = 0.0
    for i in range(len(pressures)):
        sums[rows[i]] += pressures[i]
    n = len(pressures)
    for i in range(n):
        along[i] = sums[rows[i]]
    for k in range(len(sums)):
        sums[k] = 0.0
    for i in range(n):
        sums[columns[i]] += pressures[i]
    for i in range(n):
        pressures[i] = own * pressures[i] + row * along[i] + column * sums[columns[i]]
