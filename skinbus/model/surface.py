"""Developable link surfaces: plane, cylinder and cone frustum, with one chart (s, a) for all three.

s is the length along the surface from the link's near end, a = radius * angle the arc length at the
link's reference radius; both in metres, a periodic on closed surfaces. The link frame has x along
the link; angle 0 is at +z and grows towards +y, so that s, a and the outward normal are right-handed
and a plane is the limit of a cylinder.

With the taper t = dr/ds, the signed distance to the apex is rho = r/t and the developed angle
phi = angle * t. Everything below is written so that t -> 0 (cylinder) loses no digits::

    develop:   x = s - 2 rho sin^2(phi/2),   y = rho sin(phi)
    distance:  d^2 = (s1-s2)^2 + r1 r2 angle^2 (sin(phi/2) / (phi/2))^2

Source: M. do Carmo, Differential Geometry of Curves and Surfaces, 4-2 (isometry of the cone).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats
from skinbus.model.limits import MOST_LENGTH


@dataclass(frozen=True, slots=True)
class Surface:
    """A plane (period 0), a cylinder (taper 0) or a cone frustum; use the constructors below."""

    kind: str
    length: float
    """Extent along s, m."""
    radius: float
    """Reference radius (at half length), m; 1 for a plane, where it only scales."""
    taper: float
    """Change of radius per metre of s, in (-1, 1); 0 for plane and cylinder."""
    period: float
    """Length of one turn in a, m; 0 for a plane, which has none."""
    width: float
    """Extent along a, m; the period on closed surfaces."""

    def __post_init__(self) -> None:
        lengths = (self.length, self.radius, self.width)
        if not all(0.0 < x <= MOST_LENGTH for x in lengths) or not abs(self.taper) < 1.0:
            raise ValueError(
                f"a {self.kind} of length {self.length}, radius {self.radius}, taper {self.taper} and width "
                f"{self.width}; wanted positive lengths, up to {MOST_LENGTH:g} m, and a taper within -1 and 1"
            )

    @classmethod
    def plane(cls, length: float, width: float) -> Self:
        """Return the flat sheet 0 <= s <= length, |a| <= width/2 (m)."""
        return cls("plane", length, 1.0, 0.0, 0.0, width)

    @classmethod
    def cylinder(cls, length: float, radius: float) -> Self:
        """Return the cylinder of a length and radius (m)."""
        period = math.tau * radius
        return cls("cylinder", length, radius, 0.0, period, period)

    @classmethod
    def cone(cls, length: float, radius_near: float, radius_far: float) -> Self:
        """Return the frustum with these end radii; ``length`` (m) is measured along the surface."""
        radius = 0.5 * (radius_near + radius_far)
        period = math.tau * radius
        return cls("cone", length, radius, (radius_far - radius_near) / length, period, period)

    @property
    def shape(self) -> tuple[float, float, float, float]:
        """Radius, taper, period and length, as :func:`places_on` takes them."""
        return self.radius, self.taper, self.period, self.length

    def radius_at(self, s: npt.ArrayLike) -> Floats:
        """Return the radius at s, (...,) m; 1 on a plane."""
        return np.asarray(self.radius + self.taper * (np.asarray(s, float) - 0.5 * self.length))

    def wrap(self, a: npt.ArrayLike) -> Floats:
        """Return a brought to [-period/2, period/2], (...,) m; unchanged on a plane."""
        a = np.asarray(a, float)
        if self.period == 0.0:
            return a
        return np.asarray(a - self.period * np.round(a / self.period))

    def develop(self, s: npt.ArrayLike, a: npt.ArrayLike, a0: npt.ArrayLike = 0.0) -> tuple[Floats, Floats]:
        """Return flat coordinates (x, y) in m, unrolled about the generator a0, where x = s and y = 0.

        Flat distances are geodesic distances for points within half a turn of a0.
        """
        s = np.asarray(s, float)
        angle = self.wrap(np.asarray(a, float) - a0) / self.radius
        r = self.radius_at(s)
        phi = angle * self.taper
        # rho sin(phi) = r angle sinc(phi);  2 rho sin^2(phi/2) = r angle sin(phi/2) sinc(phi/2)
        x = s - r * angle * np.sin(0.5 * phi) * _sinc(0.5 * phi)
        return x, r * angle * _sinc(phi)

    def undevelop(self, x: npt.ArrayLike, y: npt.ArrayLike, a0: npt.ArrayLike = 0.0) -> tuple[Floats, Floats]:
        """Return the chart coordinates (s, a) of flat coordinates (m): the inverse of :meth:`develop`."""
        x, y, a0 = np.asarray(x, float), np.asarray(y, float), np.asarray(a0, float)
        if self.taper == 0.0:
            return x + np.zeros_like(y), self.wrap(a0 + y)
        rx = self.radius_at(x)  # t (x + rho0): the radius on the generator y = 0
        ty = self.taper * y
        r = np.hypot(rx, ty)
        before = rx > 0.0  # the apex; beyond it r + rx may be 0
        s = x + np.where(before, self.taper * y * y / np.where(before, r + rx, 1.0), (r - rx) / self.taper)
        # the angle atan(ty/rx)/t, without loss as t -> 0
        slope = np.arctan2(ty, rx) / self.taper
        return s, self.wrap(a0 + self.radius * slope)

    def distance(self, s1: npt.ArrayLike, a1: npt.ArrayLike, s2: npt.ArrayLike, a2: npt.ArrayLike) -> Floats:
        """Return the geodesic distance of chart points, (...,) m, the short way round."""
        angle = self.wrap(np.asarray(a1, float) - np.asarray(a2, float)) / self.radius
        across = angle * _sinc(0.5 * angle * self.taper)
        r1r2 = self.radius_at(s1) * self.radius_at(s2)
        ds = np.asarray(s1, float) - np.asarray(s2, float)
        return np.asarray(np.sqrt(ds * ds + r1r2 * across * across))

    def position(self, s: npt.ArrayLike, a: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Return points (..., 3) m and outward unit normals (..., 3) in the link frame."""
        return places_on(self.shape, s, a)

    def project(self, points: npt.ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return (s, a) of the nearest points of the surface and heights over it, (n,) m, of (n, 3) m."""
        x, y, z = np.asarray(points, float).T
        if self.kind == "plane":
            return x, y, z
        r, along = np.hypot(y, z), math.sqrt(1.0 - self.taper**2)
        over = r - (self.radius - 0.5 * self.taper * self.length)
        s = along * x + self.taper * over
        return s, np.arctan2(y, z) * self.radius, along * over - self.taper * x


def places_on(shape: Iterable[Any], s: npt.ArrayLike, a: npt.ArrayLike) -> tuple[Floats, Floats]:
    """Return points (..., 3) m and outward unit normals (..., 3) of chart points.

    shape: radius, taper, period and length as :class:`Surface` has them, of all points or of each
    """
    radius, taper, period, length = shape
    s, a, taper = np.broadcast_arrays(*(np.asarray(x, float) for x in (s, a, taper)))
    angle, r = a / radius, radius + taper * (s - 0.5 * length)
    sin, cos = np.sin(angle), np.cos(angle)
    along = np.sqrt(1.0 - taper**2)  # cosine of the half angle of a cone
    flat = np.equal(period, 0.0)
    points = np.stack([s * along, np.where(flat, a, r * sin), np.where(flat, 0.0, r * cos)], -1)
    across = np.where(flat, 0.0, along * sin), np.where(flat, 1.0, along * cos)
    return points, np.stack([0.0 - taper, *across], -1)


def _sinc(x: npt.ArrayLike) -> Any:
    """Return sin(x)/x, 1 at 0."""
    return np.sinc(np.asarray(x, float) / math.pi)
