"""Stress that a surface load leaves in an elastic layer bonded to a rigid base, at the depth of the tactels.

The layer has thickness h and Poisson ratio nu; y is the height above the base, z = h - y the depth. With the
zeroth-order Hankel transform of a normal surface pressure q and no shear on the surface, Navier's
equations have the stress function f(y xi) = n1 cosh + n2 sinh + y xi (n3 cosh + n4 sinh); no displacement at
the base and no shear on the surface leave one constant, and the normal stress at height y is T q with

    T = [(n C - e S)(n c + x s) - (m s - x c)(m S + e C)] / (n^2 + kappa s^2 + x^2)

    x = xi h, c = cosh x, s = sinh x;   e = xi y, C = cosh e, S = sinh e
    n = 2 (1 - nu), m = 1 - 2 nu, kappa = 3 - 4 nu

Limits: T -> 1 as xi -> 0 (the force arrives whole); T -> (1 + xi z) exp(-xi z), Boussinesq's half-space,
when the layer is much thicker than the depth; n (n c + x s) / (n^2 + kappa s^2 + x^2) at the base.

A force F spread over a circle of radius b and averaged over a tactel of radius a at distance d gives F k(d),

    k(d) = 1/(2 pi)  integral_0^inf  T(xi) D(xi a) B(xi b) J0(xi d) xi dxi,    D(x) = 2 J1(x) / x

with the transform B of the indenter. Edges and palms are in ``layer_extended``, inclined pushes in
``layer_shear``.

Contact is small-strain, the load is normal and without friction, the surface is taken as flat over the reach
of a load.

Source: I. N. Sneddon, Fourier Transforms, 1951, ch. 10 (layers by Hankel transform); K. L. Johnson, Contact
Mechanics, 1985, 3.2 (Boussinesq) and 5.8 (bonded layers).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.special import j0

from skinbus.sim.indenter import Indenter, disc_average

Floats = npt.NDArray[np.float64]

STEP: Final = 50e-6
"""Spacing of the tables, m; linear interpolation then errs by some 1e-5 of the peak."""

_DECAY: Final = 36.0  # T falls like exp(-xi z); exp(-36) is below the last digit
_NODES: Final = 12  # of Gauss-Legendre on each panel; a panel spans at most half a period of the integrand
REACH: Final = (
    10.0  # thicknesses; beyond, the stress of a nearly incompressible layer is below 1e-4 of its peak
)
SOLVED: Final = 0.05  # depths between solved distances, a cubic spline between them


def transfer(xi: npt.ArrayLike, *, thickness: float, poisson: float, depth: float | None = None) -> Floats:
    """Return normal stress at a depth per surface pressure, both Hankel transformed, at wave numbers xi
    (1/m).

    ``depth`` (m) is counted from the surface and is that of the base unless given. Written in decaying
    exponentials, so that nothing overflows.
    """
    xi = np.asarray(xi, np.float64)
    depth = thickness if depth is None else depth
    n, m, kappa = 2.0 * (1.0 - poisson), 1.0 - 2.0 * poisson, 3.0 - 4.0 * poisson
    x, e = xi * thickness, xi * (thickness - depth)
    # hyperbolic functions divided by exp(x) and exp(e)
    c, s = 0.5 * (1.0 + np.exp(-2.0 * x)), -0.5 * np.expm1(-2.0 * x)
    C, S = 0.5 * (1.0 + np.exp(-2.0 * e)), -0.5 * np.expm1(-2.0 * e)
    above = (n * C - e * S) * (n * c + x * s) - (m * s - x * c) * (m * S + e * C)
    below = (n * n + x * x) * np.exp(-2.0 * x) + kappa * s * s
    return np.asarray(np.exp(-xi * depth) * above / below)


def wave_numbers(longest: float, depth: float) -> tuple[Floats, Floats]:
    """Return nodes xi (1/m) and weights of an integral over xi dxi of what decays like exp(-xi depth).

    ``longest`` (m) is the largest distance in the integrand. Gauss-Legendre on panels.
    """
    end = _DECAY / depth
    panels = max(12, math.ceil(end * longest / math.pi))
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    edges = np.linspace(0.0, end, panels + 1)
    half = 0.5 * np.diff(edges)[:, None]
    xi = (edges[:-1, None] + half * (1.0 + nodes)).ravel()
    return xi, (half * weights).ravel() * xi


def profile(
    d: npt.ArrayLike,
    *,
    thickness: float,
    poisson: float,
    depth: float | None = None,
    tactel_radius: float = 0.0,
    indenter_radius: float = 0.0,
    indenter: Indenter = Indenter(),  # noqa: B008  a constant
) -> Floats:
    """Return k(d), the mean pressure of a tactel per newton, at distances d (n,) m; (n,) 1/m^2.

    Args are lengths in m; a radius of zero is a point. ``indenter`` says how the force is spread over
    ``indenter_radius``; evenly, unless it is a sphere.
    """
    d = np.asarray(d, np.float64)
    z = thickness if depth is None else depth
    xi, weights = wave_numbers(max(float(d.max(initial=0.0)) + tactel_radius + indenter_radius, thickness), z)
    weights *= transfer(xi, thickness=thickness, poisson=poisson, depth=z) * disc_average(xi * tactel_radius)
    weights *= indenter.round_transform(xi * indenter_radius)
    return np.asarray(j0(np.multiply.outer(d, xi)) @ weights) / math.tau


@lru_cache(maxsize=256)
def table(
    *,
    thickness: float,
    poisson: float,
    depth: float | None = None,
    tactel_radius: float = 0.0,
    indenter_radius: float = 0.0,
    indenter: Indenter = Indenter(),  # noqa: B008  a constant
    reach: float,
) -> Floats:
    """Return k at distances 0, STEP, 2 STEP ... up to ``reach`` (m), read-only; solved once."""
    z = thickness if depth is None else depth
    step = min(SOLVED * z, 0.1 * reach)
    solved = step * np.arange(math.ceil(reach / step) + 2)
    k = profile(
        solved,
        thickness=thickness,
        poisson=poisson,
        depth=depth,
        tactel_radius=tactel_radius,
        indenter_radius=indenter_radius,
        indenter=indenter,
    )
    # k is even in d: its slope at the origin is zero
    spline = CubicSpline(solved, k, bc_type=((1, np.zeros(())), "not-a-knot"))
    fine = np.ascontiguousarray(spline(STEP * np.arange(math.ceil(reach / STEP) + 1)))
    fine.setflags(write=False)
    return fine
