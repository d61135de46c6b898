"""What a number of the model may be: what is computed within these limits stays in the range of floats."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinbus.arrays import Floats

LEAST, MOST = 1e-30, 1e30
"""Of pressures, slopes and profiles in SI units."""
LEAST_LENGTH, MOST_LENGTH = 1e-12, 1e9
"""m"""
SIZE = (LEAST, MOST)
ANY = (-MOST, MOST)
LENGTH = (LEAST_LENGTH, MOST_LENGTH)


def check_numbers(name: str, values: Any, limits: tuple[float, float]) -> Floats:
    """Return numbers as an array.

    Raises:
        ValueError: they are masked, NaN, or beyond their limits.
    """
    least, most = limits
    numbers = np.asarray(values, np.float64)
    if np.ma.is_masked(values) or not ((numbers >= least) & (numbers <= most)).all():
        raise ValueError(f"{name} must be from {least:g} to {most:g}, none masked; got {values}")
    return numbers
