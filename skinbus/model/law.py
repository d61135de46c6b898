"""Contact laws: the pressure under a contact of force F at distance d.

cone (the paper, eq. 5-10)::

    p(d) = max(0, H - |S| d),   H = |S| R,   R = (3 F / (pi |S|))^(1/3),   F = pi H^3 / (3 S^2)

radial (measured by calibration)::

    p(d) = F k(d),   k a table over d, in 1/m^2; it may be slightly negative in its tail

Eq. 8 of the paper is an approximation and is not used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Cone:
    """The paper's cone: pressure falls by ``slope`` (Pa/m, positive) from its peak."""

    slope: float = 1.2e6  # the cone of the figures in DESIGN section 4

    def height(self, force: npt.ArrayLike) -> Floats:
        """Return the peak pressure H under forces (N), (...,) Pa; eq. 5 and 7."""
        return np.asarray(np.cbrt(3.0 * np.asarray(force, float) * self.slope**2 / math.pi))

    def reach(self, force: npt.ArrayLike) -> Floats:
        """Return the radius R of the base of the cone, (...,) m; eq. 5."""
        return self.height(force) / self.slope

    def pressure(self, d: npt.ArrayLike, force: npt.ArrayLike) -> Floats:
        """Return the pressure at distances d (m) from contacts of given force (N), (...,) Pa; eq. 9."""
        return np.maximum(0.0, self.height(force) - self.slope * np.asarray(d, float))

    def force(self, pressure: npt.ArrayLike, d: npt.ArrayLike) -> Floats:
        """Return the force of a contact that makes ``pressure`` (Pa) at distance d (m); eq. 10, 5, 6.

        A pressure of zero or less says nothing of the force and gives 0.
        """
        pressure = np.asarray(pressure, float)
        height = pressure + self.slope * np.asarray(d, float)
        return np.where(pressure > 0.0, math.pi * height**3 / (3.0 * self.slope**2), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Radial:
    """A measured profile: ``table[i]`` is k at distance ``i * step`` (1/m^2 over m), zero beyond its end."""

    step: float
    table: Floats

    def reach(self, force: npt.ArrayLike) -> Floats:
        """Return the distance at which the table ends, (...,) m; it does not depend on the force."""
        return np.full(np.shape(force), self.step * (len(self.table) - 1))

    def pressure(self, d: npt.ArrayLike, force: npt.ArrayLike) -> Floats:
        """Return the pressure at distances d (m) from contacts of given force (N), (...,) Pa."""
        grid = self.step * np.arange(len(self.table))
        k = np.interp(np.asarray(d, float), grid, self.table, right=0.0)
        return np.asarray(np.asarray(force, float) * k)


Law = Cone | Radial
