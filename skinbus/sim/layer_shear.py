"""What an inclined push adds: a tangential load on the bonded layer of ``bonded_layer``.

With tangential traction q sin(xi x) on the surface, no normal one, and no displacement at the base, the
normal stress at height y is T1 q cos(xi x): pressure ahead of the push, as much less behind it. The
displacements have Papkovich-Neuber's potentials phi and psi, each a sum of exp(-xi (h - y)) and exp(-xi y)::

    2G u_x = -d/dx (phi + y psi)      2G u_y = (3 - 4 nu) psi - d/dy phi - y d/dy psi

and four boundary conditions give their four constants at each wave number. A push Q at distance d, at an
angle theta to the direction of Q, adds Q cos(theta) k1(d) to the mean pressure of a tactel of radius a,

    k1(d) = 1/(2 pi)  integral_0^inf  T1(xi) D(xi a) B(xi b) J1(xi d) xi dxi

with the transforms D of the tactel's disc and B of the indenter. Limits: T1 -> xi h as xi -> 0; T1 -> xi z
exp(-xi z), Cerruti's half-space, when the layer is much thicker than the depth z.

Friction is Coulomb's: a push above ``friction`` times the normal force slips and has that much.
Source: K. L. Johnson, Contact Mechanics, 1985, 3.6 (Cerruti); J. R. Barber, Elasticity, ch. 21 (potentials).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.special import j1

from skinbus.sim.bonded_layer import SOLVED, STEP, wave_numbers
from skinbus.sim.indenter import Indenter, disc_average
from skinbus.sim.layer import Floats


def shear_transfer(xi: npt.ArrayLike, *, thickness: float, poisson: float, depth: float) -> Floats:
    """Return pressure at a depth per tangential surface traction, transformed, at wave numbers xi (1/m)."""
    xi = np.atleast_1d(np.asarray(xi, np.float64))
    x, y = xi * thickness, xi * (thickness - depth)
    n, m, kappa = 2.0 * (1.0 - poisson), 1.0 - 2.0 * poisson, 3.0 - 4.0 * poisson
    zero = np.zeros_like(xi)

    def rows(e: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return u_x, u_y, sigma_yy and tau_xy (per xi, per xi^2) at height e / xi of the four potentials."""
        up, down = np.exp(e - x), np.exp(-e)
        ones = np.stack([up, down], -1)
        slopes = np.stack([up, -down], -1)
        at = e[:, None]
        return (
            np.concatenate([ones, at * ones], -1),
            np.concatenate([-slopes, kappa * ones - at * slopes], -1),
            np.concatenate([-ones, n * slopes - at * ones], -1),
            np.concatenate([slopes, -m * ones + at * slopes], -1),
        )

    base, surface = rows(zero), rows(x)
    system = np.stack([base[0], base[1], surface[2], surface[3]], -2)
    # two potentials that are nearly one at long waves: their sum and difference are far apart
    mix = np.array([[1.0, 1.0, 0, 0], [1.0, -1.0, 0, 0], [0, 0, 1.0, 1.0], [0, 0, 1.0, -1.0]]).T
    load = np.zeros((len(xi), 4, 1))
    load[:, 3] = 1.0
    constants = np.linalg.solve(system @ mix, load)
    return np.asarray((rows(y)[2][:, None, :] @ mix @ constants)[:, 0, 0])


def shear_profile(
    d: npt.ArrayLike,
    *,
    thickness: float,
    poisson: float,
    depth: float,
    tactel_radius: float = 0.0,
    indenter_radius: float = 0.0,
    indenter: Indenter = Indenter(),  # noqa: B008  a constant
) -> Floats:
    """Return k1(d), ahead of a tangential newton, at d (n,) m; (n,) 1/m^2. Arguments as ``profile``."""
    d = np.asarray(d, np.float64)
    xi, weights = wave_numbers(
        max(float(d.max(initial=0.0)) + tactel_radius + indenter_radius, thickness), depth
    )
    weights *= shear_transfer(xi, thickness=thickness, poisson=poisson, depth=depth)
    weights *= disc_average(xi * tactel_radius) * indenter.round_transform(xi * indenter_radius)
    return np.asarray(j1(np.multiply.outer(d, xi)) @ weights) / math.tau


@lru_cache(maxsize=256)
def shear_table(
    *, tactel_radius: float, indenter_radius: float, indenter: Indenter, reach: float, **layer: float
) -> Floats:
    """Return k1 at distances 0, STEP, 2 STEP ... up to ``reach`` (m)."""
    step = min(SOLVED * layer["depth"], 0.1 * reach)
    solved = step * np.arange(math.ceil(reach / step) + 2)
    k = shear_profile(
        solved, tactel_radius=tactel_radius, indenter_radius=indenter_radius, indenter=indenter, **layer
    )
    return np.asarray(CubicSpline(solved, k)(STEP * np.arange(math.ceil(reach / STEP) + 1)))
