"""Stress that a surface load leaves in an elastic layer bonded to a rigid base, at the depth of the tactels.

The layer has thickness h and Poisson ratio nu; y is the height above the base, where the tactels are. For a
surface traction q that varies like a wave of number xi, Navier's equations have the stress function
f(y xi) = a cosh + b sinh + y xi (c cosh + d sinh). No displacement at the base is a = -n d and b = m c; the
traction on the surface gives c and d. The normal stress at the base is T q with, for a normal traction T0 and
for a tangential one T1, a quarter of a wave behind,

    T0 = n (n c + x s) / (n^2 + kappa s^2 + x^2)
    T1 = n (m s + x c) / (n^2 + kappa s^2 + x^2)

    x = xi h, c = cosh x, s = sinh x;   n = 2 (1 - nu), m = 1 - 2 nu, kappa = 3 - 4 nu

Limits: T0 -> 1 as xi -> 0 (the force arrives whole), T1 -> x. Without a base, with the tactels at the depth h
of a half-space, T0 = (1 + x) exp(-x), Boussinesq's, and T1 = x exp(-x), Cerruti's.

A force F spread over a circle of radius b and averaged over a tactel of radius a at distance d gives F k(d),

    k(d) = 1/(2 pi)  integral_0^inf  T0(xi) D(xi a) B(xi b) J0(xi d) xi dxi,    D(x) = 2 J1(x) / x

with the transform B of the indenter; a tangential force Q at an angle theta to the tactel Q cos(theta) k1(d)
with T1 and J1: pressure ahead of the push, as much less behind it.

The pressure of an edge or a palm at displacement (u, v) from its centre, along and across, is

    p(u, v) = F/(4 pi^2)  integral integral  T0(xi) D(xi a) B(k_u, k_v) cos(k_u u) cos(k_v v) dk_u dk_v

with xi^2 = k_u^2 + k_v^2. It is evaluated once, on a grid over a quarter of the plane, by a fast Fourier
transform: the spectrum falls like exp(-xi z), so that a grid of GRID depths leaves out nothing; a bilinear
look-up errs by 1.5e-3 of the peak at most.

Contact is small-strain; the surface is taken as flat over the reach of a load.

Source: I. N. Sneddon, Fourier Transforms, 1951, ch. 10 (layers by Hankel transform); K. L. Johnson, Contact
Mechanics, 1985, 3.2 (Boussinesq), 3.6 (Cerruti) and 5.8 (bonded layers).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.fft import irfft2, next_fast_len
from scipy.interpolate import CubicSpline
from scipy.special import j0, j1

from skinbus.arrays import Floats
from skinbus.sim.indenter import Indenter, disc_average

STEP = 50e-6
"""Spacing of the tables, m; linear interpolation then errs by some 1e-5 of the peak."""

_DECAY = 36.0  # T falls like exp(-xi z); exp(-36) is below the last digit
_NODES = 12  # of Gauss-Legendre on each panel; a panel spans at most half a period of the integrand
REACH = 10.0  # thicknesses; beyond, the stress of a nearly incompressible layer is below 1e-4 of its peak
SOLVED = 0.05  # depths between solved distances, a cubic spline between them
GRID = 0.04
"""Depths between grid points. Linear interpolation errs by step^2/8 (|p_uu| + |p_vv|); under a line load the
half-space has p_vv = -4 p/z^2 at its peak, which gives 8e-4 of it; what is wider is smoother."""
MAX_POINTS = 2**23
"""Of one grid, 64 MB; a larger one is made coarser."""


def transfer(
    xi: npt.ArrayLike,
    *,
    thickness: float,
    poisson: float | None,
    tangential: bool = False,
) -> Floats:
    """Return normal stress at the tactels per surface traction, both transformed, at wave numbers xi (1/m).

    Without ``poisson`` there is no base: a half-space, with tactels at the depth ``thickness``. Written in
    decaying exponentials, so that nothing overflows.
    """
    x = np.asarray(xi, np.float64) * thickness
    if poisson is None:
        return np.asarray(np.exp(-x) * (x + (not tangential)))
    n, m, kappa = 2.0 * (1.0 - poisson), 1.0 - 2.0 * poisson, 3.0 - 4.0 * poisson
    # hyperbolic functions divided by exp(x)
    c, s = 0.5 * (1.0 + np.exp(-2.0 * x)), -0.5 * np.expm1(-2.0 * x)
    above = n * (m * s + x * c if tangential else n * c + x * s)
    below = (n * n + x * x) * np.exp(-2.0 * x) + kappa * s * s
    return np.asarray(np.exp(-x) * above / below)


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
    poisson: float | None,
    tactel_radius: float = 0.0,
    indenter_radius: float = 0.0,
    indenter: Indenter = Indenter(),  # noqa: B008  a constant
    tangential: bool = False,
) -> Floats:
    """Return k(d), the mean pressure of a tactel per newton, at distances d (n,) m; (n,) 1/m^2.

    Args are lengths in m; a radius of zero is a point. ``indenter`` says how the force is spread over
    ``indenter_radius``; evenly, unless it is a sphere. ``tangential``: k1, ahead of a tangential newton.
    """
    d = np.asarray(d, np.float64)
    longest = max(float(d.max(initial=0.0)) + tactel_radius + indenter_radius, thickness)
    xi, weights = wave_numbers(longest, thickness)
    weights *= transfer(xi, thickness=thickness, poisson=poisson, tangential=tangential)
    weights *= disc_average(xi * tactel_radius) * indenter.round_transform(xi * indenter_radius)
    bessel = j1 if tangential else j0
    return np.asarray(bessel(np.multiply.outer(d, xi)) @ weights) / math.tau


@lru_cache(maxsize=256)
def table(*, reach: float, thickness: float, tangential: bool = False, **more: Any) -> Floats:
    """Return k of :func:`profile` at distances 0, STEP, 2 STEP ... up to ``reach`` (m), read-only."""
    step = min(SOLVED * thickness, 0.1 * reach)
    solved = step * np.arange(math.ceil(reach / step) + 2)
    k = profile(solved, thickness=thickness, tangential=tangential, **more)
    # k is even in d, k1 is odd: its slope, or its curvature, at the origin is zero
    at_origin: Any = (2 if tangential else 1, np.zeros(()))
    fine = CubicSpline(solved, k, bc_type=(at_origin, "not-a-knot"))(
        STEP * np.arange(math.ceil(reach / STEP) + 1)
    )
    fine.setflags(write=False)
    return np.asarray(fine)


@lru_cache(maxsize=8)
def quarter_plane(
    indenter: Indenter, *, thickness: float, poisson: float | None, tactel_radius: float
) -> tuple[Floats, float]:
    """Return pressures per newton, (n_u, n_v) 1/m^2 at multiples of a step, and the step (m)."""
    beyond = REACH * thickness + tactel_radius
    half_u, half_v = 0.5 * indenter.length + beyond, 0.5 * indenter.width + beyond
    step = max(GRID * thickness, math.sqrt(half_u * half_v / MAX_POINTS))
    # the period of the transform is twice the plane: images lie beyond the reach of each other
    n_u, n_v = (next_fast_len(2 * math.ceil(half / step), real=True) for half in (half_u, half_v))
    n_v += n_v % 2
    k_u = math.tau * np.abs(np.fft.fftfreq(n_u, step))[:, None]
    k_v = math.tau * np.asarray(np.fft.rfftfreq(n_v, step), np.float64)
    xi = np.hypot(k_u, k_v)
    spectrum: Floats = transfer(xi, thickness=thickness, poisson=poisson)
    spectrum *= disc_average(xi * tactel_radius)
    spectrum *= indenter.transform(k_u, k_v)
    plane = irfft2(spectrum, s=(n_u, n_v), overwrite_x=True) / (step * step)
    return np.ascontiguousarray(plane[: n_u // 2, : n_v // 2]), step
