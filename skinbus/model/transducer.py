"""Counts of the analogue inputs to pressure and back.

CiA 401: readings are signed and left-adjusted, full scale is 0x7FFF (16 bit) or 0x7F (8 bit)
whatever the resolution of the converter behind them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

LEAST, MOST = 1e-30, 1e30
"""Pa: what is computed of a full scale stays within the range of floats."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transducer:
    """Linear scale of a patch: ``full_scale`` Pa at the largest count of ``bits`` bits."""

    full_scale: float
    bits: int = 16

    def __post_init__(self) -> None:
        if not LEAST <= self.full_scale <= MOST:
            raise ValueError(f"full_scale must be from {LEAST:g} to {MOST:g} Pa, got {self.full_scale}")
        if not 2 <= self.bits <= 16:
            raise ValueError(f"bits must be from 2 to 16, got {self.bits}")

    @property
    def full_counts(self) -> int:
        """Largest reading: 0x7FFF or 0x7F."""
        return (1 << (self.bits - 1)) - 1

    @property
    def step(self) -> float:
        """Pressure of one count, Pa."""
        return self.full_scale / self.full_counts

    def pressure(self, counts: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the pressures of counts, (...,) Pa."""
        return np.asarray(counts, np.float64) * self.step

    def counts(self, pressure: npt.ArrayLike) -> npt.NDArray[np.int16]:
        """Return the nearest counts of pressures (Pa), clipped to the range; NaN reads as 0."""
        scaled = np.rint(np.nan_to_num(np.asarray(pressure, np.float64) / self.step, nan=0.0))
        return np.clip(scaled, -self.full_counts - 1, self.full_counts).astype(np.int16)
