"""The surface of a link that is a triangle mesh: one flat chart (s, a), with points and normals on a grid.

The chart is conformal (``robot.flattening``): it keeps angles, and a short way on the surface is ``scale``
times as long in it. Where the mesh can be unrolled the scale is 1 and flat distances are geodesic distances,
as on the other surfaces; elsewhere the scale at a tactel is part of its width, and ``bend`` has how it
changes around it. A chart that goes around a link is periodic in a.

Points are those of the mesh at the nodes of the grid, bilinear between them: 2 mm on a radius of 40 mm err by
0.013 mm, less than edges of 3 mm do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from skinbus.arrays import Bools, Floats, Ints
from skinbus.model.surface import Surface


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeshSurface(Surface):
    """A mesh as a surface of a link; as a plane where its chart is not closed, else as a cylinder."""

    first: tuple[float, float]
    """Chart coordinates of the first node, m."""
    step: float
    """Distance of nodes, m."""
    nodes: Floats
    """(n_s, n_a, 6) point (m) and outward normal; beyond the mesh those of the nearest place on it."""
    on: Bools
    """(n_s, n_a) whether a node is on the mesh."""
    points: Floats
    """(n, 3) m, of the whole mesh, for those who draw it."""
    triangles: Ints
    """(m, 3)"""

    def position(self, s: npt.ArrayLike, a: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Return points (..., 3) m and outward unit normals (..., 3) in the link frame."""
        value = self._at(*np.broadcast_arrays(np.asarray(s, float), self.wrap(a)))[0]
        normal = value[..., 3:]
        return value[..., :3], normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def project(self, points: npt.ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return (s, a) of the nearest points of the surface and heights over it, (n,) m, of (n, 3) m."""
        wanted = np.asarray(points, float)
        tree = cKDTree(self.nodes[self.on][:, :3])
        k = tree.query(wanted)[1]
        s, a = (self.first + self.step * np.argwhere(self.on)[k]).T
        for _ in range(3):  # Newton from the nearest node; the second step is below a nanometre
            value, along, across = self._at(s, self.wrap(a))
            slopes = np.stack([along[:, :3], across[:, :3]], -1)  # one is 0 beyond the grid
            steps = np.linalg.pinv(slopes, 1e-3) @ (wanted - value[:, :3])[..., None]
            s, a = np.stack([s, a]) + np.clip(steps[..., 0].T, -self.step, self.step)
        point, normal = self.position(s, a)
        return np.asarray(s), self.wrap(a), np.asarray(((wanted - point) * normal).sum(axis=1))

    def contains(self, s: npt.ArrayLike, a: npt.ArrayLike) -> Bools:
        """Return whether places are on the mesh, to half a step of the grid."""
        i, j = (
            np.rint((np.asarray(x, float) - first) / self.step).astype(int)
            for x, first in zip((s, self.wrap(a)), self.first, strict=True)
        )
        n_s, n_a = self.on.shape
        inside = (i >= 0) & (i < n_s) & (j >= 0) & (j < n_a)
        return np.asarray(inside & self.on[np.clip(i, 0, n_s - 1), np.clip(j, 0, n_a - 1)])

    def area_at(self, s: npt.ArrayLike, a: npt.ArrayLike) -> Floats:
        """Return the area of the mesh per area of the chart, (n,); 0 beside the mesh."""
        _, along, across = self._at(np.asarray(s, float), self.wrap(a))
        area = np.linalg.norm(np.cross(along[..., :3], across[..., :3]), axis=-1)
        return np.asarray(np.where(self.contains(s, a), area, 0.0))

    def _at(self, s: npt.NDArray[Any], a: npt.NDArray[Any]) -> tuple[Floats, Floats, Floats]:
        """Return point and normal (..., 6), bilinear, and their derivatives by s and a."""
        n_s, n_a, _ = self.nodes.shape
        x, y = (s - self.first[0]) / self.step, (a - self.first[1]) / self.step
        i = np.clip(np.floor(x).astype(int), 0, n_s - 2)
        j = np.clip(np.floor(y).astype(int), 0, n_a - 2)
        # beyond the grid the place stays at its rim
        x, y = np.clip(x - i, 0.0, 1.0)[..., None], np.clip(y - j, 0.0, 1.0)[..., None]
        low, high = self.nodes[i, j], self.nodes[i + 1, j]
        low_across, high_across = self.nodes[i, j + 1] - low, self.nodes[i + 1, j + 1] - high
        before, after = low + y * low_across, high + y * high_across
        along = (after - before) / self.step
        return before + x * (after - before), along, (low_across + x * (high_across - low_across)) / self.step
