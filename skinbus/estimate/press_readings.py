"""The readings of presses that a response is learned from, as columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.response_algebra import POINTS

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]


class Readings(NamedTuple):
    """Usable readings, one row each."""

    p: Floats
    press: Ints
    tactel: Ints
    d: Floats
    """m, from the press to the tactel."""
    away: Floats
    """(n, 2) m, from the tactel to the press along s and a."""
    log_force: Floats
    """Relative to ``middle``."""
    middle: float
    """Logarithm of the geometric mean of the forces."""
    n_presses: int
    step: float
    """m, of the table."""
    floor: Floats
    """(n_tactels,) Pa, the standard deviation that rounding alone gives a reading."""
    place_sd: float
    """m, of the places of the presses along each direction; 0 where they are exact, and forces, too."""

    @property
    def reach(self) -> float:
        """Distance at which the table ends, m."""
        return self.step * (POINTS - 1)
