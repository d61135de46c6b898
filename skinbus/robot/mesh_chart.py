"""A chart of a triangle mesh around a place: flat coordinates whose distances from there are geodesic.

The logarithmic map of the place, by the vector heat method, on the part of the mesh that is near enough.
Boards are laid onto a mesh by it: a tactel (u, v) of a board lies where the chart has these coordinates.

Distances from the centre are exact but for the mesh; those between two places beside it are stretched by the
curvature, in proportion to K r^2 / 6 (10 % at 40 mm on a sphere of 50 mm).
Source: N. Sharp, Y. Soliman, K. Crane, The vector heat method (2019), 8.2; the affine variant of its library.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from skinbus.errors import SkinbusError
from skinbus.robot.mesh import Mesh, parts_of

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

REACH: Final = 0.06
"""m: half a board of 50 mm, and 35 mm over its neighbours: as far as a contact on its edge is felt."""
MARGIN: Final = 1.5
"""The map is computed on a part so much larger: heat feels the rim of the part."""
_NEAREST: Final = 24
"""Triangles by their middles among which the nearest one of a point is looked for."""
VERSION: Final = b"1"
"""Of the files that are kept: another one where the method changes."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshChart:
    """A chart: points (n, 3) m, their coordinates uv (n, 2) m, triangles (m, 3), all outward."""

    points: Floats
    uv: Floats
    triangles: Ints

    def locate(self, points: npt.ArrayLike) -> Floats:
        """Return the coordinates (n, 2) m of the places of the surface nearest to points (n, 3) m."""
        triangle, weights = nearest_places(self.points, self.triangles, np.asarray(points, np.float64))
        return np.asarray(np.einsum("nk,nkx->nx", weights, self.uv[self.triangles[triangle]]))

    def lift(self, uv: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Return points and outward unit normals (n, 3) of coordinates (n, 2) m; NaN outside of the chart."""
        wanted = np.asarray(uv, np.float64)
        a, b, c = np.moveaxis(self.uv[self.triangles], 1, 0)
        u, v = b - a, c - a
        det = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        corners = self.points[self.triangles]
        flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        smooth = np.zeros_like(self.points)
        for k in range(3):
            np.add.at(smooth, self.triangles[:, k], flat)
        points, normals = np.full((len(wanted), 3), np.nan), np.full((len(wanted), 3), np.nan)
        for n, place in enumerate(wanted):
            s = place - a
            with np.errstate(divide="ignore", invalid="ignore"):
                x = (s[:, 0] * v[:, 1] - s[:, 1] * v[:, 0]) / det
                y = (u[:, 0] * s[:, 1] - u[:, 1] * s[:, 0]) / det
            inside = np.minimum(np.minimum(x, y), 1.0 - x - y)
            inside[~(det > 0.0)] = -np.inf  # folded over: beyond the reach of the chart
            k = int(np.argmax(inside))
            if inside[k] < -1e-9:
                continue
            weights = np.array([1.0 - x[k] - y[k], x[k], y[k]])
            points[n] = weights @ corners[k]
            normal = weights @ smooth[self.triangles[k]]
            normals[n] = normal / np.linalg.norm(normal)
        return points, normals


def chart_at(
    mesh: Mesh, point: npt.ArrayLike, along: npt.ArrayLike, *, reach: float = REACH, kept: Path | None = None
) -> MeshChart:
    """Return the chart around the place of a mesh nearest to a point (3,) m.

    along: (3,) direction of u, projected on the surface; seen from outside v is to its left
    reach: geodesic distance that it has at least, where the mesh goes so far, m
    kept:  folder where charts are kept by their content

    Raises:
        ValueError: the direction is along the normal, or not finite.
        SkinbusError: potpourri3d is not installed.
    """
    place, direction = np.asarray(point, np.float64), np.asarray(along, np.float64)
    if place.shape != (3,) or direction.shape != (3,) or not np.isfinite([place, direction]).all():
        raise ValueError(
            f"a point and a direction of three numbers, got {place.tolist()} and {direction.tolist()}"
        )
    content: tuple[npt.NDArray[Any], ...] = (mesh.points, mesh.triangles, place, direction, np.array([reach]))
    file = None
    if kept is not None:
        digest = hashlib.sha256(VERSION)
        for array in content:
            digest.update(np.ascontiguousarray(array).tobytes())
        file = kept / f"{digest.hexdigest()}.npz"
        chart = _read(file)
        if chart is not None:
            return chart
    chart = _compute(mesh, place, direction, reach)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        new = file.with_suffix(f".{os.getpid()}.npz")
        np.savez(new, points=chart.points, uv=chart.uv, triangles=chart.triangles)
        new.replace(file)
    return chart


def _read(file: Path) -> MeshChart | None:
    """Return a chart that was kept, None where there is none or it is damaged."""
    try:
        with np.load(file, allow_pickle=False) as data:
            return MeshChart(data["points"], data["uv"], data["triangles"])
    except (OSError, ValueError, KeyError, EOFError):
        return None


def _compute(mesh: Mesh, place: Floats, direction: Floats, reach: float) -> MeshChart:
    try:
        from potpourri3d import MeshVectorHeatSolver
    except ImportError as error:
        raise SkinbusError("a mesh needs potpourri3d: pip install 'skinbus[mesh]'") from error
    (triangle,), (weights,) = nearest_places(mesh.points, mesh.triangles, place[None])
    middle = weights @ mesh.points[mesh.triangles[triangle]]
    normal = mesh.normals[triangle]
    flat = direction - (direction @ normal) * normal
    if np.linalg.norm(flat) < 1e-6 * np.linalg.norm(direction) or not direction.any():
        raise ValueError(f"the direction {direction} is along the normal of the mesh at {1e3 * middle} mm")
    near = np.linalg.norm(mesh.points - middle, axis=1) <= MARGIN * reach
    near[mesh.triangles[triangle]] = True
    part = mesh.triangles[near[mesh.triangles].any(axis=1)]
    _, label = parts_of(len(mesh.points), part)
    part = part[label[part[:, 0]] == label[mesh.triangles[triangle, 0]]]
    used = np.unique(part)
    points, part = mesh.points[used], np.searchsorted(used, part)
    source = int(np.argmin(np.linalg.norm(points - middle, axis=1)))
    solver = MeshVectorHeatSolver(points, part)
    uv = np.asarray(solver.compute_log_map(source), np.float64)
    chart = MeshChart(points, uv, part)
    # from the corner to the place itself, and the first axis into the direction
    uv = uv - chart.locate(middle[None])[0]
    step = 0.25 * float(np.linalg.norm(points[part[:, 0]] - points[part[:, 1]], axis=1).mean())
    corners = points[part[_triangle_of(part, used, mesh.triangles[triangle])]]
    gradient = _gradient(corners, uv[part[_triangle_of(part, used, mesh.triangles[triangle])]])
    first = gradient @ (flat / np.linalg.norm(flat)) * step
    left = gradient @ (np.cross(normal, flat) / np.linalg.norm(flat)) * step
    angle = np.arctan2(first[1], first[0])
    cos, sin = np.cos(angle), np.sin(angle)
    turned = uv @ np.array([[cos, -sin], [sin, cos]])
    if first[0] * left[1] - first[1] * left[0] < 0.0:
        turned[:, 1] *= -1.0
    distance = np.linalg.norm(turned, axis=1)
    kept = part[(distance[part] <= reach * 1.05 + 4.0 * step).all(axis=1)]
    return MeshChart(points, turned, kept)


def _triangle_of(part: Ints, used: Ints, corners: Ints) -> int:
    """Return the number of a triangle of the mesh in a part of it."""
    return int(np.flatnonzero((part == np.searchsorted(used, corners)).all(axis=1))[0])


def _gradient(corners: Floats, uv: Floats) -> Floats:
    """Return the derivative (2, 3) of coordinates by place within a triangle."""
    edges = np.stack([corners[1] - corners[0], corners[2] - corners[0]])
    rises = np.stack([uv[1] - uv[0], uv[2] - uv[0]])
    return np.asarray((np.linalg.pinv(edges) @ rises).T)


def nearest_places(points: Floats, triangles: Ints, wanted: Floats) -> tuple[Ints, Floats]:
    """Return the triangle (n,) nearest to each of (n, 3) points, and the weights (n, 3) of its corners."""
    corners = points[triangles]
    tree = cKDTree(corners.mean(axis=1))
    near = np.array(tree.query(wanted, min(_NEAREST, len(triangles)))[1], np.int64).reshape(len(wanted), -1)
    weights = _weights(corners[near], wanted[:, None])
    places = np.einsum("nmk,nmkx->nmx", weights, corners[near])
    apart: Floats = np.asarray(np.linalg.norm(places - wanted[:, None], axis=2))
    rows, best = np.arange(len(wanted)), np.array(apart.argmin(axis=1), np.int64)
    return near[rows, best], weights[rows, best]


def _weights(corners: Floats, wanted: Floats) -> Floats:
    """Return the weights (..., 3) of the corners (..., 3, 3) at the place nearest to a point (..., 3)."""
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    u, v, s = b - a, c - a, wanted - a
    uu, uv, vv = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    us, vs = (u * s).sum(-1), (v * s).sum(-1)
    det = uu * vv - uv * uv
    x, y = (vv * us - uv * vs) / det, (uu * vs - uv * us) / det
    inner = np.stack([1.0 - x - y, x, y], -1)
    best = np.where(np.all(inner >= 0.0, axis=-1, keepdims=True), inner, np.nan)
    least = np.where(np.isnan(best[..., 0]), np.inf, 0.0)
    for i, j in ((0, 1), (1, 2), (2, 0)):  # outside: on the nearest edge
        p, e = corners[..., i, :], corners[..., j, :] - corners[..., i, :]
        along = np.clip(((wanted - p) * e).sum(-1) / (e * e).sum(-1), 0.0, 1.0)
        apart = np.linalg.norm(p + along[..., None] * e - wanted, axis=-1)
        on_edge = np.zeros_like(inner)
        on_edge[..., i], on_edge[..., j] = 1.0 - along, along
        is_nearer = apart < least
        best = np.where(is_nearer[..., None], on_edge, best)
        least = np.where(is_nearer, apart, least)
    return np.asarray(best)
