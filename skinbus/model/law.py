"""Contact laws: the pressure under a contact of force F at distance d.

Both laws act on the effective force f = F^exponent (F in N; exponent 1 for a linear skin, below 1
for one whose response flattens)::

    cone (the paper, eq. 5-10)
        p(d) = max(0, H - |S| d),   H = |S| R,   R = (3 f / (pi |S|))^(1/3),   f = pi H^3 / (3 S^2)

    radial (measured by calibration)
        p(d) = f k(d),   k a smooth table over d, in 1/m^2; it may be slightly negative in its tail

Eq. 8 of the paper is an approximation and is not used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats
from skinbus.model.limits import ANY, LENGTH, MOST, SIZE, check_numbers

EXPONENT = (0.01, 100.0)
NOT_NEGATIVE = (0.0, MOST)


@dataclass(frozen=True, slots=True)
class Cone:
    """The paper's cone: pressure falls by ``slope`` (Pa/m, positive) from its peak."""

    slope: float = 1.2e6  # within the range of the figures of the paper
    exponent: float = 1.0
    misfit: float = 0.0
    """Standard deviation of what the law does not explain, as a part of the pressure."""
    misfit_profile: ClassVar[None] = None

    def __post_init__(self) -> None:
        check_numbers("slope", self.slope, SIZE)
        check_numbers("exponent", self.exponent, EXPONENT)
        check_numbers("misfit", self.misfit, NOT_NEGATIVE)

    def height(self, force: npt.ArrayLike) -> Floats:
        """Return the peak pressure H under forces (N), (...,) Pa; eq. 5 and 7."""
        effective = _effective(force, self.exponent)
        # cbrt(slope) twice, not slope**2: the square of an extreme slope leaves the range of floats
        return np.asarray(np.cbrt(3.0 * effective / math.pi) * np.cbrt(self.slope) ** 2)

    def reach(self, force: npt.ArrayLike) -> Floats:
        """Return the radius R of the base of the cone, (...,) m; eq. 5."""
        return self.height(force) / self.slope

    def pressure(self, d: npt.ArrayLike, force: npt.ArrayLike) -> Floats:
        """Return the pressure at distances d (m) from contacts of given force (N), (...,) Pa; eq. 9."""
        return np.maximum(0.0, self.height(force) - self.slope * np.asarray(d, float))

    def unexplained(self, d: npt.ArrayLike, force: npt.ArrayLike) -> Floats:
        """Return the standard deviation of what the law leaves at distances d (m), (...,) Pa."""
        return self.misfit * self.pressure(d, force)

    def force(self, pressure: npt.ArrayLike, d: npt.ArrayLike) -> Floats:
        """Return the force of a contact that makes ``pressure`` (Pa) at distance d (m); eq. 10, 5, 6.

        A pressure of zero or less says nothing of the force and gives 0.
        """
        pressure = np.asarray(pressure, float)
        height = np.maximum(0.0, pressure) + self.slope * np.asarray(d, float)
        effective = math.pi / 3.0 * (height / np.cbrt(self.slope) ** 2) ** 3
        return np.where(pressure > 0.0, effective ** (1.0 / self.exponent), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Radial:
    """A measured profile: ``table[i]`` is k at distance ``i * step`` (1/m^2 over m), zero beyond its end.

    Between its points the table is the cubic with the central differences as slopes, which keeps the
    derivative continuous; k is even in d, so its slope at 0 is 0.
    """

    step: float
    table: Floats
    exponent: float = 1.0
    misfit: float = 0.0
    """Standard deviation of what the law does not explain, as a part of the pressure."""
    misfit_profile: Floats | None = None
    """Standard deviation of what the law leaves at the distances of the table, 1/m^2; it takes the place of
    ``misfit``, which is zero where a law predicts nothing and there a real skin deviates most."""
    typical_force: float = 0.0
    """Geometric mean of the forces that it was measured with, N: the middle of a weak prior; 0 for none."""

    def __post_init__(self) -> None:
        check_numbers("step", self.step, LENGTH)
        check_numbers("exponent", self.exponent, EXPONENT)
        check_numbers("misfit", self.misfit, NOT_NEGATIVE)
        check_numbers("typical_force", self.typical_force, NOT_NEGATIVE)
        table = check_numbers("table", self.table, ANY)
        if table.ndim != 1 or not len(table) or not table[0] > 0.0:
            raise ValueError("table must be one row of numbers that begins above 0")
        if self.misfit_profile is not None:
            spread = check_numbers("misfit_profile", self.misfit_profile, NOT_NEGATIVE)
            if spread.shape != table.shape:
                raise ValueError("misfit_profile must be as long as table")

    def reach(self, force: npt.ArrayLike) -> Floats:
        """Return the distance at which the table ends, (...,) m; it does not depend on the force."""
        return np.full(np.shape(force), self.step * (len(self.table) - 1))

    def profile(self, d: npt.ArrayLike) -> Floats:
        """Return k at distances d (m), (...,) 1/m^2."""
        table = np.asarray(self.table, float)
        if len(table) == 1:
            return np.where(np.asarray(d, float) == 0.0, table[0], 0.0)
        slopes = np.gradient(table)
        slopes[0] = 0.0
        x = np.asarray(d, float) / self.step
        inside = x <= len(table) - 1
        i = np.minimum(np.where(inside, x, 0.0).astype(np.int64), len(table) - 2)
        t = np.where(inside, x, 0.0) - i
        rise = table[i + 1] - table[i]
        bend = slopes[i] + slopes[i + 1] - 2.0 * rise
        cubic = table[i] + t * (slopes[i] + t * (rise - slopes[i] - bend + t * bend))
        return np.where(inside, cubic, 0.0)

    def pressure(self, d: npt.ArrayLike, force: npt.ArrayLike) -> Floats:
        """Return the pressure at distances d (m) from contacts of given force (N), (...,) Pa."""
        return np.asarray(_effective(force, self.exponent) * self.profile(d))

    def unexplained(self, d: npt.ArrayLike, force: npt.ArrayLike) -> Floats:
        """Return the standard deviation of what the law leaves at distances d (m), (...,) Pa."""
        if self.misfit_profile is None:
            return self.misfit * self.pressure(d, force)
        at = self.step * np.arange(len(self.table))
        left = np.interp(np.asarray(d, float), at, self.misfit_profile, right=0.0)
        return np.asarray(_effective(force, self.exponent) * left)

    def force(self, pressure: npt.ArrayLike, d: npt.ArrayLike) -> Floats:
        """Return the force of a contact that makes ``pressure`` (Pa) at distance d (m).

        0 where the pressure or the profile is not positive: such a reading says nothing of the force.
        """
        pressure, k = np.broadcast_arrays(np.asarray(pressure, float), self.profile(d))
        known = (pressure > 0.0) & (k > 0.0)
        ratio = np.where(known, pressure, 0.0) / np.where(known, k, 1.0)
        return np.asarray(ratio ** (1.0 / self.exponent))


Law = Cone | Radial
DEFAULT_LAW = Cone()
"""The law of a board that says nothing of its own."""


def _effective(force: npt.ArrayLike, exponent: float) -> Floats:
    """Return force^exponent; forces below zero count as none."""
    return np.asarray(np.maximum(0.0, np.asarray(force, float)) ** exponent)
