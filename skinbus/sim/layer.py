"""What every layer law shares: where tactels are, which loads press, and the way from a load to each tactel.

A law adds the pressure of each load to the tactels of its link.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from skinbus.arrays import Floats, Ints
from skinbus.model import Arm
from skinbus.model.mesh_surface import MeshSurface

_DIRECTION = 0.5e-3
"""m, over which the direction of s is taken at a load on a mesh: far less than any radius."""


class Loads:
    """Columns of surface loads: preallocated, or of values that are given.

    link, s, a (m), force (N)
    indenter      number of the indenter
    radius        of the contact, m: grows with the force under a sphere
    yaw           direction of an edge or palm, rad from s towards a
    pull_s, pull_a   tangential force per normal force, along s and a
    """

    def __init__(self, capacity: int, **given: Any) -> None:
        self.n = capacity if given else 0
        self.link, self.indenter = np.zeros((2, capacity), np.int32)
        self.s, self.a, self.force, self.radius, self.yaw, self.pull_s, self.pull_a = np.zeros((7, capacity))
        for name, values in given.items():
            getattr(self, name)[:] = values


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
    _on_mesh: dict[int, tuple[Floats, Floats]] = field(default_factory=dict)
    """Points and normals of the tactels, by link; looked up once."""

    @classmethod
    def of(cls, arm: Arm, *, discs: bool) -> Geometry:
        """Return the geometry as the arm file says it, with the boards' discs or with points."""
        diameters = np.array([placed.patch.diameter if discs else 0.0 for placed in arm.patches])
        return cls(arm, arm.tactel_s.copy(), arm.tactel_a.copy(), diameters[arm.tactel_patch])

    def ways(self, link: int, s: float, a: float, turn: int | None = None) -> tuple[Ints, Floats, Floats]:
        """Return the tactels of a link, and the way to each from a place along s and around, m.

        Their length is the distance on the surface. The shorter way around is taken, or one that is ``turn``
        turns longer than that of the chart.
        """
        arm = self.arm
        tactels = np.flatnonzero(arm.tactel_link == link)
        surface = arm.links[link].surface
        if isinstance(surface, MeshSurface):
            if turn:  # a mesh shows each tactel once
                return tactels[:0], np.zeros(0), np.zeros(0)
            if link not in self._on_mesh:
                self._on_mesh[link] = surface.position(self.s[tactels], self.a[tactels])
            seen = _seen_on(surface, s, a, *self._on_mesh[link])
            return tactels, seen[:, 0], seen[:, 1]
        radius, taper, period, length = arm.link_shapes[link]
        around = self.a[tactels] - a
        if turn is not None:
            around += turn * period
        elif period > 0.0:
            around -= period * np.rint(around / period)
        angle = around / radius
        angle *= np.sinc(
            0.5 / np.pi * taper * angle
        )  # the chord of a cone that is rolled out; of sinc pi is a part
        middle = 0.5 * length
        radii = (radius + taper * (self.s[tactels] - middle)) * (radius + taper * (s - middle))
        return tactels, self.s[tactels] - s, np.sqrt(radii) * angle


class Law(Protocol):
    """A layer law bound to an arm."""

    def add(self, loads: Loads, pressures: Floats) -> None:
        """Add the pressures of all loads, (n_tactels,) Pa."""


def _seen_on(surface: MeshSurface, s: float, a: float, points: Floats, normals: Floats) -> Floats:
    """Return the ways (n, 2) m from a place on a mesh to points; apart from the estimator's chart."""
    near, normal = surface.position(s + np.array([0.0, -_DIRECTION, _DIRECTION]), np.full(3, a))
    along = near[2] - near[1]
    along = along - (along @ normal[0]) * normal[0]
    return seen_from(near[0], normal[0], along / (np.linalg.norm(along) or 1.0), points, normals)


def seen_from(point: Floats, normal: Floats, along: Floats, points: Floats, normals: Floats) -> Floats:
    """Return points (n, 3) m, with unit normals, as seen from one with a direction of s, (n, 2) m.

    Each is at its geodesic distance: that of an arc with the chord c whose ends are inclined as much as the
    tangents are, d = c x / sin(x), sin(x) = the mean of the sines between the chord and the tangents at both
    ends; exact on planes and spheres, and wrong by how the curvature changes on the way elsewhere.

    Source: M. do Carmo, Differential Geometry of Curves and Surfaces, 1-5 (local canonical form).
    """
    chord = points - point
    length = np.linalg.norm(chord, axis=1)
    unit = chord / np.maximum(length, 1e-12)[:, None]
    sine = np.clip(0.5 * ((unit * normals).sum(axis=1) - unit @ normal), -1.0, 1.0)
    arc = length / np.sinc(np.arcsin(sine) / np.pi)
    x, y = unit @ along, unit @ np.cross(normal, along)
    flat = np.maximum(np.hypot(x, y), 1e-12)
    return np.asarray(np.stack([arc * x / flat, arc * y / flat], -1))
