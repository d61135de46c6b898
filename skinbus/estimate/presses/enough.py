"""Where the next press adds most, and whether more presses would make a calibration better.

The error at presses that a calibration was not made from falls with their number n as E^2 = A + B / n.
Cross-validation with two folds learns from n / 2 presses, with five from 4 n / 5: the two give A and B.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from skinbus.estimate.presses.cross_validation import FOLDS, RIM, cross_validate
from skinbus.estimate.presses.table import Floats, PressTable
from skinbus.model import Patch

WORTH: Final = 0.05
"""Part of the error that twice the presses must take away: less is not worth the hour."""
STEP: Final = 0.125
"""Pitches between the places that are considered."""


class Progress(NamedTuple):
    """Errors to expect of places, m: of as many presses as there are, and of twice as many."""

    now: float
    doubled: float

    @property
    def is_enough(self) -> bool:
        """Whether more presses would not help."""
        return self.doubled >= (1.0 - WORTH) * self.now


def progress_of(table: PressTable) -> Progress:
    """Return the errors to expect; infinite where nothing can be learned yet."""
    n = len(table)
    half, most = cross_validate(table, folds=2).place(), cross_validate(table).place()
    if not (math.isfinite(half) and math.isfinite(most)):
        return Progress(math.inf, 0.0)
    share = 1.0 - 1.0 / FOLDS
    b = max(half**2 - most**2, 0.0) * n / (2.0 - 1.0 / share)
    a = max(most**2 - b / (share * n), 0.0)
    return Progress(math.sqrt(a + b / n), math.sqrt(a + 0.5 * b / n))


def next_place(patch: Patch, pressed: Floats) -> Floats:
    """Return the place (2,) m on a board that is farthest from those pressed, (n, 2) m.

    Places lie within the tactels and a quarter of a pitch around; the first is the middle.
    """
    uv = np.asarray(patch.tactels_uv)
    pitch = patch.pitch
    low, high = uv.min(axis=0) - RIM * pitch, uv.max(axis=0) + RIM * pitch
    if not len(pressed):
        return np.asarray(0.5 * (low + high))
    counts = np.maximum(np.ceil((high - low) / (STEP * pitch)), 1.0).astype(int) + 1
    at = np.stack(np.meshgrid(*(np.linspace(*ends) for ends in zip(low, high, counts, strict=True))), -1)
    at = at.reshape(-1, 2)
    apart = np.hypot(*(at[:, None] - pressed).T).min(axis=0)
    return np.asarray(at[int(apart.argmax())])
