"""Residual map: what a tactel reads beside its radial law, by where the board is pressed."""

from __future__ import annotations

from dataclasses import dataclass

from skinbus.arrays import Floats
from skinbus.model.limits import ANY, LENGTH, check_numbers


@dataclass(frozen=True, slots=True, eq=False)
class ResidualMap:
    """Values on a square grid around each tactel, in the frame of the board; zero beyond it.

    ``values[i, x, y]`` is what tactel i reads more than its law says, per newton (of effective force), when
    pressed ``(x - h) * step`` along u and ``(y - h) * step`` along v from it, h the middle of an odd number
    of points. Between the points it is the bicubic with central differences as slopes.
    """

    step: float
    """m"""
    values: Floats
    """(n_tactels, points, points) 1/m^2"""

    def __post_init__(self) -> None:
        check_numbers("step", self.step, LENGTH)
        values = check_numbers("values", self.values, ANY)
        if values.ndim != 3 or values.shape[1] != values.shape[2] or not values.shape[1] % 2:
            raise ValueError(f"values must have shape (n_tactels, odd, odd), got {values.shape}")

    def mirrored(self) -> ResidualMap:
        """Return the map of the board with v running the other way."""
        return ResidualMap(self.step, self.values[:, :, ::-1])

    @property
    def reach(self) -> float:
        """Distance along an axis at which the maps end, m."""
        return float(self.step * (self.values.shape[1] // 2))
