"""The chart of ``model.surface`` in kernels: distances with their derivatives, developed coordinates.

A link is four numbers: radius, taper, period, length. The equations are those of ``model.surface``.
"""

from __future__ import annotations

import math

from skinbus.jit import kernel


@kernel
def wrap(a: float, period: float) -> float:
    """Return a brought to half a period (m) around 0; unchanged where there is none."""
    if -0.5 * period <= a <= 0.5 * period or period == 0.0:
        return a
    return a - period * math.floor(a / period + 0.5)


@kernel
def distance(
    radius: float, taper: float, period: float, length: float, s1: float, a1: float, s2: float, a2: float
) -> float:
    """Return the geodesic distance of two points of a link, m."""
    ds = s1 - s2
    da = wrap(a1 - a2, period)
    if taper == 0.0:
        return math.sqrt(ds * ds + da * da)
    r1 = radius + taper * (s1 - 0.5 * length)
    r2 = radius + taper * (s2 - 0.5 * length)
    across = math.sin(0.5 * taper * da / radius) * 2.0 / taper
    return math.sqrt(ds * ds + max(r1 * r2, 0.0) * across * across)


@kernel
def separation(
    radius: float, taper: float, period: float, length: float, s: float, a: float, sj: float, aj: float
) -> tuple[float, float, float]:
    """Return the squared distance of (s, a) from (sj, aj) in m^2, and half its derivatives by s and a.

    Divided by the distance d these are d d/ds and d d/da; who only wants to know if d is small needs no root.
    """
    ds = s - sj
    da = wrap(a - aj, period)
    if taper == 0.0:
        return ds * ds + da * da, ds, da
    r = radius + taper * (s - 0.5 * length)
    rj = radius + taper * (sj - 0.5 * length)
    half = 0.5 * taper * da / radius
    across = math.sin(half) * 2.0 / taper
    along = ds + 0.5 * taper * rj * across * across
    return ds * ds + max(r * rj, 0.0) * across * across, along, r * rj * across * math.cos(half) / radius


@kernel
def develop(
    radius: float, taper: float, period: float, length: float, s: float, a: float, a0: float
) -> tuple[float, float]:
    """Return flat coordinates (x, y) in m, unrolled about the generator a0."""
    da = wrap(a - a0, period)
    if taper == 0.0:
        return s, da
    phi = taper * da / radius
    rho = (radius + taper * (s - 0.5 * length)) / taper
    sin = math.sin(0.5 * phi)
    return s - 2.0 * rho * sin * sin, rho * math.sin(phi)


@kernel
def undevelop(
    radius: float, taper: float, period: float, length: float, x: float, y: float, a0: float
) -> tuple[float, float]:
    """Return the chart coordinates (s, a) of flat coordinates (m): the inverse of :func:`develop`."""
    if taper == 0.0:
        return x, wrap(a0 + y, period)
    rx = radius + taper * (x - 0.5 * length)
    ty = taper * y
    r = math.sqrt(rx * rx + ty * ty)
    s = x + ty * y / (r + rx)
    return s, wrap(a0 + radius * math.atan2(ty, rx) / taper, period)
