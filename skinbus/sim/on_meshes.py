"""A layer law on links that are meshes: distances along the surface, apart from the estimator's chart.

The law adds up over loads in chart coordinates. For a load on a mesh each tactel is put where it is seen
from the load: at its geodesic distance, in its direction. The distance is that of an arc with the chord c
whose ends are inclined as much as the tangents are,

    d = c x / sin(x),   sin(x) = the mean of the sines between the chord and the tangents at both ends

exact on planes and spheres, and wrong by how the curvature changes on the way elsewhere.

Source: M. do Carmo, Differential Geometry of Curves and Surfaces, 1-5 (local canonical form).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skinbus.model.mesh_surface import MeshSurface
from skinbus.sim.layer import Geometry, Law, Loads

Floats = npt.NDArray[np.float64]

_DIRECTION = 0.5e-3
"""m, over which the direction of s is taken at a load: far less than any radius."""


def seen_from(point: Floats, normal: Floats, along: Floats, points: Floats, normals: Floats) -> Floats:
    """Return points (n, 3) m, with unit normals, as seen from one with a direction of s, (n, 2) m."""
    chord = points - point
    length = np.linalg.norm(chord, axis=1)
    unit = chord / np.maximum(length, 1e-12)[:, None]
    sine = np.clip(0.5 * ((unit * normals).sum(axis=1) - unit @ normal), -1.0, 1.0)
    arc = length / np.sinc(np.arcsin(sine) / np.pi)  # of np.sinc pi is a part
    x, y = unit @ along, unit @ np.cross(normal, along)
    flat = np.maximum(np.hypot(x, y), 1e-12)
    return np.asarray(np.stack([arc * x / flat, arc * y / flat], -1))


class OnMeshes:
    """A law on an arm with meshes; loads on other links are left to it as they are."""

    def __init__(self, law: Law, geometry: Geometry) -> None:
        """``law`` is bound to ``geometry``, whose places of tactels on meshes are set for each load."""
        arm = geometry.arm
        self._law, self._geometry = law, geometry
        self._meshes: dict[int, tuple[MeshSurface, npt.NDArray[np.intp], Floats, Floats]] = {}
        for k, link in enumerate(arm.links):
            if isinstance(link.surface, MeshSurface):
                tactels = np.flatnonzero(arm.tactel_link == k)
                places = link.surface.position(geometry.s[tactels], geometry.a[tactels])
                self._meshes[k] = link.surface, tactels, *places
        self._one = Loads(1)
        self._one.n = 1
        self._others: Loads | None = None

    def add(self, loads: Loads, pressures: Floats, touched: npt.NDArray[np.bool_]) -> None:
        """Add the pressures of all loads, (n_tactels,) Pa, and mark the patches written to, (n_patches,)."""
        if self._others is None:
            self._others = Loads(len(loads.link))
        others, n = self._others, 0
        for j in range(loads.n):
            k = int(loads.link[j])
            if k not in self._meshes:
                _copy(loads, j, others, n)
                n += 1
                continue
            surface, tactels, points, normals = self._meshes[k]
            s, a = float(loads.s[j]), float(loads.a[j])
            near, normal = surface.position(s + np.array([0.0, -_DIRECTION, _DIRECTION]), np.full(3, a))
            along = near[2] - near[1]
            along = along - (along @ normal[0]) * normal[0]
            along /= np.linalg.norm(along) or 1.0
            seen = seen_from(near[0], normal[0], along, points, normals)
            self._geometry.s[tactels], self._geometry.a[tactels] = s + seen[:, 0], a + seen[:, 1]
            _copy(loads, j, self._one, 0)
            self._law.add(self._one, pressures, touched)
        others.n = n
        if n or not loads.n:  # with no loads at all kernels are compiled
            self._law.add(others, pressures, touched)


def _copy(source: Loads, j: int, to: Loads, n: int) -> None:
    for name in Loads.__slots__:
        if name != "n":
            getattr(to, name)[n] = getattr(source, name)[j]
