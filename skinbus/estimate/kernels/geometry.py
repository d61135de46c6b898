"""The chart of ``model.surface`` in kernels: distances with their derivatives, developed coordinates.

The equations are those of ``model.surface``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from skinbus.arrays import Floats
from skinbus.jit import inner_kernel


class LinkSurface(NamedTuple):
    """The surface of a link, handed on by value: loops keep it in registers."""

    radius: float  # m, at half the length; that of the plane is 1
    taper: float
    period: float  # m, 0 where the surface is not closed
    length: float  # m


@inner_kernel
def surface_of(links: Floats, link: int) -> LinkSurface:
    """Return the surface in row ``link`` of a table (n_links, 4)."""
    return LinkSurface(links[link, 0], links[link, 1], links[link, 2], links[link, 3])


@inner_kernel
def wrap(a: float, period: float) -> float:
    """Return a brought to half a period (m) around 0; unchanged where there is none."""
    half = 0.5 * period
    if -half <= a <= half or period == 0.0:
        return a
    turns = a / period + 0.5
    whole = int(turns)  # rounded down without a call, which would cost the loops around it their registers
    return a - period * (whole - (turns < whole))


@inner_kernel
def separation(surface: LinkSurface, s: float, a: float, sj: float, aj: float) -> tuple[float, float, float]:
    """Return the squared distance of (s, a) from (sj, aj) in m^2, and half its derivatives by s and a.

    Divided by the distance they are its derivatives by s and a; a comparison with a limit needs no root.
    """
    ds = s - sj
    da = wrap(a - aj, surface.period)
    if surface.taper == 0.0:
        return ds * ds + da * da, ds, da
    r = surface.radius + surface.taper * (s - 0.5 * surface.length)
    rj = surface.radius + surface.taper * (sj - 0.5 * surface.length)
    half = 0.5 * surface.taper * da / surface.radius
    across = math.sin(half) * 2.0 / surface.taper
    along = ds + 0.5 * surface.taper * rj * across * across
    return (
        ds * ds + max(r * rj, 0.0) * across * across,
        along,
        r * rj * across * math.cos(half) / surface.radius,
    )


@inner_kernel
def distance(surface: LinkSurface, s1: float, a1: float, s2: float, a2: float) -> float:
    """Return the geodesic distance of two points of a link, m."""
    return math.sqrt(separation(surface, s1, a1, s2, a2)[0])


@inner_kernel
def are_within(surface: LinkSurface, limit: float, s1: float, a1: float, s2: float, a2: float) -> bool:
    """Return whether two points of a link are less than ``limit`` (m) from each other."""
    return abs(s1 - s2) < limit and separation(surface, s1, a1, s2, a2)[0] < limit * limit


@inner_kernel
def develop(surface: LinkSurface, s: float, a: float, a0: float) -> tuple[float, float]:
    """Return flat coordinates (x, y) in m, unrolled about the generator a0."""
    da = wrap(a - a0, surface.period)
    if surface.taper == 0.0:
        return s, da
    phi = surface.taper * da / surface.radius
    rho = (surface.radius + surface.taper * (s - 0.5 * surface.length)) / surface.taper
    sin = math.sin(0.5 * phi)
    return s - 2.0 * rho * sin * sin, rho * math.sin(phi)


@inner_kernel
def undevelop(surface: LinkSurface, x: float, y: float, a0: float) -> tuple[float, float]:
    """Return the chart coordinates (s, a) of flat coordinates (m): the inverse of :func:`develop`."""
    if surface.taper == 0.0:
        return x, wrap(a0 + y, surface.period)
    rx = surface.radius + surface.taper * (x - 0.5 * surface.length)
    ty = surface.taper * y
    r = math.sqrt(rx * rx + ty * ty)
    s = x + ty * y / (r + rx)
    return s, wrap(a0 + surface.radius * math.atan2(ty, rx) / surface.taper, surface.period)
