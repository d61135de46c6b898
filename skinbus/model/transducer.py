"""Counts of the analogue inputs to pressure and back.

CiA 401: readings are signed and left-adjusted, full scale is 0x7FFF (16 bit) or 0x7F (8 bit)
whatever the resolution of the converter behind them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats, Ints32
from skinbus.model.limits import SIZE, check_numbers

USUAL_BITS = 12
"""Of the converters inside common microcontrollers, sign included."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transducer:
    """Linear scale of a patch: ``full_scale`` Pa at the largest count of ``bits`` bits."""

    full_scale: float
    bits: int = 16
    """Of a reading, sign included."""
    converter_bits: int | None = None
    """Of the converter, sign included; None for one as fine as the readings."""

    def __post_init__(self) -> None:
        check_numbers("full_scale", self.full_scale, SIZE)
        for bits in (self.bits, self.converter_bits or self.bits):
            if not 2 <= bits <= 32:
                raise ValueError(f"bits must be from 2 to 32, got {bits}")

    @property
    def full_counts(self) -> int:
        """Largest count that a reading has room for: 0x7FFF or 0x7F."""
        return (1 << (self.bits - 1)) - 1

    @property
    def converter_counts(self) -> int:
        """Counts from one value of the converter to the next: 16 for one of 12 bits in readings of 16."""
        return 1 << max(self.bits - (self.converter_bits or self.bits), 0)

    @property
    def top_counts(self) -> int:
        """Largest reading: 0x7FF0 from a converter of 12 bits."""
        return self.full_counts + 1 - self.converter_counts

    @property
    def clipped_counts(self) -> float:
        """Counts above which a reading may be full scale: half a step below the top of a usual converter.

        Readings of 16 bits come from converters of 12 more often than their EDS says so.
        """
        coarsest = max(self.converter_counts, 1 << max(self.bits - USUAL_BITS, 0))
        return self.full_counts + 1 - 1.5 * coarsest

    @property
    def step(self) -> float:
        """Pressure of one count, Pa."""
        return self.full_scale / self.full_counts

    @property
    def resolution(self) -> float:
        """Pressure from one value of the converter to the next, Pa."""
        return self.step * self.converter_counts

    def pressure(self, counts: npt.ArrayLike) -> Floats:
        """Return the pressures of counts, (...,) Pa."""
        return np.asarray(counts, np.float64) * self.step

    def counts(self, pressure: npt.ArrayLike) -> Ints32:
        """Return the nearest readings of pressures (Pa), clipped to the range; NaN reads as 0."""
        values = np.rint(np.nan_to_num(np.asarray(pressure, np.float64) / self.resolution, nan=0.0))
        counts = np.clip(values * self.converter_counts, -self.full_counts - 1, self.top_counts)
        return np.asarray(counts, np.int32)
