"""Noise of single readings: what a board needs, where presses are means over many cycles.

A calibration learns the noise of the readings it is made from. Means have less than what an estimator gets,
cycle by cycle: with a noise half as large as it is, an arm on which nothing presses finds contacts.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from skinbus.estimate.calibration import Calibration
from skinbus.estimate.presses.table import Floats, PressTable

QUIET: Final = 0.1
"""Part of the largest reading of a press below which a tactel shows its noise, not that of the force."""
FEWEST: Final = 5
"""Presses with such readings; with fewer the noise under presses counts, too."""


def single_noise(table: PressTable, learned: Calibration) -> Floats:
    """Return the noise of a single reading, (n_tactels,) Pa of true pressure.

    It is what the file says, else what was learned from single readings; of means of which nothing is
    known it is at least what the board declares.
    """
    declared = np.asarray(table.arm.tactel_noise)
    otherwise = learned.noise if table.are_single else np.maximum(learned.noise, declared)
    if table.noise is None:
        return otherwise
    given = np.isfinite(table.noise) & np.isfinite(table.pressures)
    most = np.nanmax(table.pressures, axis=1, keepdims=True, initial=0.0)
    quiet = given & (np.abs(np.nan_to_num(table.pressures)) < QUIET * most)
    noise = otherwise.copy()
    for i in np.flatnonzero(given.any(axis=0)).tolist():
        rows = quiet[:, i] if quiet[:, i].sum() >= FEWEST else given[:, i]
        noise[i] = np.sqrt(np.mean(table.noise[rows, i] ** 2))
    # as given in the unit of the arm's gains; the learned ones take their place
    gain = np.asarray(learned.gain) / np.asarray(table.arm.tactel_gain)
    return np.asarray(np.where(given.any(axis=0), noise * gain, otherwise))


def mean_and_noise(cycles: Floats) -> tuple[Floats, Floats]:
    """Return means and standard deviations of readings over cycles (n, n_tactels), (n_tactels,) Pa each.

    NaN in readings is left out; the mean of none is NaN, and so is the standard deviation of less than two.
    """
    is_read = np.isfinite(cycles)
    n = is_read.sum(axis=0)
    mean = np.where(is_read, cycles, 0.0).sum(axis=0) / np.where(n > 0, n, np.nan)
    square = np.where(is_read, cycles - mean, 0.0) ** 2
    return mean, np.sqrt(square.sum(axis=0) / np.where(n > 1, n - 1, np.nan))
