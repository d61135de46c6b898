"""What every layer law shares: where tactels are, which loads press, and which tactels are within reach.

A law adds the pressure of each load to the tactels of the patches it reaches; all other tactels are never
looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from skinbus.jit import inner_kernel
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]


STRETCH = 0.02
"""m, more than the chart of a mesh is off over the reach of a load: so only what is far is left out."""


class Loads:
    """Preallocated columns of surface loads.

    link, s, a (m), force (N)
    indenter      number of the indenter
    radius        of the contact, m: grows with the force under a sphere
    yaw           direction of an edge or palm, rad from s towards a
    pull_s, pull_a   tangential force per normal force, along s and a
    """

    __slots__ = ("a", "force", "indenter", "link", "n", "pull_a", "pull_s", "radius", "s", "yaw")

    def __init__(self, capacity: int) -> None:
        self.n = 0
        self.link = np.zeros(capacity, np.int32)
        self.indenter = np.zeros(capacity, np.int32)
        self.s, self.a, self.force, self.radius, self.yaw, self.pull_s, self.pull_a = np.zeros((7, capacity))


class ResponseColumns(NamedTuple):
    """How each tactel's response differs from that of the layer; see the effect of that name."""

    gain: Floats
    """(n_tactels,)"""
    shape: Floats
    """(n_tactels, 2, 2) from a displacement to the one that the table of the layer is read at, per metre"""
    waves: Floats
    """(n_tactels, n_waves, 3) the smooth residual: wave numbers along s and a (1/m), phase (rad)"""
    residual: Floats
    """(2, n) distances (m) and standard deviations of the residual there, as shares of the peak"""


@dataclass(slots=True)
class Geometry:
    """Where the tactels really are and how large: what effects change before a law is bound."""

    arm: Arm
    s: Floats
    """(n_tactels,) m"""
    a: Floats
    """(n_tactels,) m"""
    diameter: Floats
    """(n_tactels,) m, of the disc over which a tactel averages; 0 samples at a point."""
    offset: Floats | None = None
    """(n_tactels,) Pa, what a tactel reads of no load at all, beyond what its board's file says."""
    response: ResponseColumns | None = None
    friction: float | None = None
    """Coefficient between indenters and the cover; None where pushes are not inclined."""

    @classmethod
    def of(cls, arm: Arm, *, discs: bool) -> Geometry:
        """Return the geometry as the arm file says it, with the boards' discs or with points."""
        counts = np.diff(arm.patch_start)
        diameters = np.array([placed.patch.diameter if discs else 0.0 for placed in arm.patches])
        return cls(arm, arm.tactel_s.copy(), arm.tactel_a.copy(), np.repeat(diameters, counts))


class Surroundings(NamedTuple):
    """The columns that kernels need to find the tactels near a load."""

    tactel_s: Floats
    tactel_a: Floats
    tactel_r: Floats
    patch_start: Ints
    patch_link: Ints
    patch_s: Floats
    patch_a: Floats
    patch_extent: Floats
    """Distance of the farthest tactel from the patch centre, m."""
    link_radius: Floats
    link_taper: Floats
    link_period: Floats
    link_length: Floats


class Law(Protocol):
    """A layer law bound to an arm."""

    def add(self, loads: Loads, pressures: Floats, touched: npt.NDArray[np.bool_]) -> None:
        """Add the pressures of all loads, (n_tactels,) Pa, and mark the patches written to, (n_patches,)."""


def surroundings(geometry: Geometry) -> Surroundings:
    """Return the columns of an arm whose tactels are where ``geometry`` says."""
    arm = geometry.arm
    radius = np.empty(arm.n_tactels)
    extent = np.zeros(arm.n_patches)
    for p, placed in enumerate(arm.patches):
        at = arm.tactels_of(p)
        surface = arm.links[placed.link].surface
        radius[at] = surface.radius_at(geometry.s[at])
        extent[p] = surface.distance(placed.s, placed.a, geometry.s[at], geometry.a[at]).max()
        if placed.on_chart is not None:
            extent[p] += STRETCH
    return Surroundings(
        geometry.s,
        geometry.a,
        radius,
        arm.patch_start,
        arm.patch_link,
        arm.patch_s,
        arm.patch_a,
        extent,
        arm.link_radius,
        arm.link_taper,
        arm.link_period,
        arm.link_length,
    )


def classes(values: Floats) -> tuple[Floats, Ints]:
    """Return the distinct values and the class of each: tables are solved once for each class."""
    distinct, inverse = np.unique(values, return_inverse=True)
    return distinct, inverse.astype(np.int32)


@inner_kernel
def displacement(s1: float, a1: float, r1: float, s2: float, a2: float, r2: float, link: Any) -> Any:
    """Return the way (m) from point 2 to point 1 along s and around; arguments as ``geodesic``."""
    return s1 - s2, np.sqrt(r1 * r2) * _across(a1 - a2, link)


@inner_kernel
def geodesic(s1: float, a1: float, r1: float, s2: float, a2: float, r2: float, link: Any) -> float:
    """Return the distance (m) of two chart points with radii r1, r2; ``link`` is that of ``link_at``."""
    across = _across(a1 - a2, link)
    distance: float = np.sqrt((s1 - s2) ** 2 + r1 * r2 * across * across)
    return distance


@inner_kernel
def _across(da: float, link: Any) -> Any:
    radius, taper, period = link
    if period > 0.0:
        da -= period * np.rint(da / period)
    across = da / radius
    half = 0.5 * across * taper
    if half * half > 1e-16:
        across *= np.sin(half) / half
    return across


@inner_kernel
def link_at(near: Surroundings, k: int) -> Any:
    """Return radius, taper and period of a link."""
    return near.link_radius[k], near.link_taper[k], near.link_period[k]


@inner_kernel
def radius_at(near: Surroundings, k: int, s: float) -> Any:
    """Return the radius of a link at s, m."""
    return near.link_radius[k] + near.link_taper[k] * (s - 0.5 * near.link_length[k])


@inner_kernel
def is_reached(near: Surroundings, p: int, k: int, s: float, a: float, reach: float) -> Any:
    """Return whether a load at a place of link k, which reaches so far (m), is felt by a patch."""
    if near.patch_link[p] != k:
        return False
    r_patch, r = radius_at(near, k, near.patch_s[p]), radius_at(near, k, s)
    to_patch = geodesic(near.patch_s[p], near.patch_a[p], r_patch, s, a, r, link_at(near, k))
    return to_patch <= near.patch_extent[p] + reach
