"""Indenters: the shapes that press, and the pressure each spreads over the surface, as its transform.

::

    point   all of the force in one place
    disc    even over a diameter
    sphere  Hertz's half-ellipsoid over a circle that grows with the force, up to the finger's own diameter
    edge    an even line load
    palm    a soft pad: a paraboloid over an ellipse that fills length and width

A transform is that of the pressure per newton: 1 at wave number 0.
Source: K. L. Johnson, Contact Mechanics, 1985, eq. 3.39 and 4.22 (Hertz); transforms by Sonine's integral.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import j1, jv

from skinbus.arrays import Floats

N_GROWTH = 33
"""Radii at which the table of a sphere is solved; linear in between errs by less than 2e-3 of the peak."""


class Shape(IntEnum):
    """What presses."""

    POINT = 0
    DISC = 1
    EDGE = 2
    PALM = 3
    SPHERE = 4

    @property
    def is_round(self) -> bool:
        """Whether the pressure depends on the distance from the centre alone."""
        return self not in (Shape.EDGE, Shape.PALM)


class Indenter(NamedTuple):
    """The shape and size of what presses; equal ones share their tables."""

    shape: Shape = Shape.POINT
    length: float = 0.0
    """Diameter of a disc or finger, length of an edge or palm, m."""
    width: float = 0.0
    """Width of a palm, m."""
    modulus: float = 0.0
    """Contact modulus of a sphere on the cover, Pa."""

    def radii(self) -> Floats:
        """Return the contact radii (m) that tables are solved for: evenly spaced from 0, or the only one."""
        if self.shape is Shape.SPHERE:
            return np.linspace(0.0, 0.5 * self.length, N_GROWTH)
        return np.array([0.5 * self.length])

    def round_transform(self, x: npt.ArrayLike) -> Floats:
        """Return the transform of a round contact of radius b at x = wave number times b."""
        return hertz_average(x) if self.shape is Shape.SPHERE else disc_average(x)

    def transform(self, k_u: Floats, k_v: Floats) -> Floats:
        """Return the transform of an edge or palm at wave numbers (1/m) along its length and width."""
        along = 0.5 * self.length * k_u
        if self.shape is Shape.EDGE:
            return np.asarray(np.sinc(along / math.pi), np.float64)
        q = np.hypot(along, 0.5 * self.width * k_v)
        small = q < 1e-3
        safe = np.where(small, 1.0, q)
        exact: Floats = 8.0 * jv(2, safe) / (safe * safe)
        return np.asarray(np.where(small, 1.0 - q * q / 12.0, exact))


def disc_average(x: npt.ArrayLike) -> Floats:
    """Return 2 J1(x)/x, the transform of an even disc of radius a at x = xi a; 1 at 0."""
    x = np.asarray(x, np.float64)
    small = x < 1e-4
    safe = np.where(small, 1.0, x)
    return np.where(small, 1.0 - x * x / 8.0, 2.0 * j1(safe) / safe)


def hertz_average(x: npt.ArrayLike) -> Floats:
    """Return 3 (sin x - x cos x)/x^3, the transform of Hertz's pressure over radius a at x = xi a; 1 at 0."""
    x = np.asarray(x, np.float64)
    small = x < 1e-2
    safe = np.where(small, 1.0, x)
    exact = 3.0 * (np.sin(safe) - safe * np.cos(safe)) / safe**3
    return np.asarray(np.where(small, 1.0 - x * x / 10.0 + x**4 / 280.0, exact))
