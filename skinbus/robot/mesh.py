"""Triangle meshes of links: read from STL, OBJ or PLY, checked, and mended where that is safe.

Mended: corners that coincide are joined, triangles without area and doubled ones are left out; a closed
surface is turned outward. Refused: what is not one connected surface, wound alike, in which at most two
triangles meet at an edge, and what is too large or of a size that no link has. Geodesics go around open rims.
"""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from skinbus.arrays import Floats, Ints
from skinbus.errors import ConfigError, Fault, FaultList, extra_wanted
from skinbus.file_bytes import read_bytes

MOST_TRIANGLES = 300_000
"""A link of a square metre at edges of 3 mm has 260 000; more take minutes and say nothing about a skin."""
MOST_BYTES = 100_000_000
"""Of a file: so many triangles as text, with normals and names."""
SIZES = (0.02, 5.0)
"""m, of the longest side: outside of these the unit is wrong."""
FORMATS = (".stl", ".obj", ".ply")
_NEAREST = 24
"""Triangles by their middles among which the nearest one of a point is looked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """One connected surface.

    points     (n, 3) m
    triangles  (m, 3) corners, counter-clockwise seen from outside
    """

    points: Floats
    triangles: Ints

    def normals(self, triangles: Ints | slice = slice(None)) -> Floats:
        """Return outward unit normals (n, 3) of triangles (n,), or of all."""
        a, b, c = np.moveaxis(self.points[self.triangles[triangles]], 1, 0)
        normal = np.cross(b - a, c - a)
        return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])

    def at(self, triangles: Ints, weights: Floats) -> Floats:
        """Return places (n, 3) m of triangles (n,) by the weights (n, 3) of their corners."""
        return np.asarray(np.einsum("nk,nkx->nx", weights, self.points[self.triangles[triangles]]))


def load_mesh(path: str | Path, unit: float = 1e-3) -> Mesh:
    """Return the mesh of a file; ``unit`` is the length of its unit, m.

    Raises:
        ConfigError: it cannot be read, or is refused: all faults.
        SkinbusError: trimesh is not installed.
    """
    trimesh = _trimesh()
    kind = Path(path).suffix.lower()
    if kind not in FORMATS:
        raise ConfigError.of(path, "mesh", kind, f"a file {', '.join(FORMATS)}")
    content = BytesIO(read_bytes(Path(path), MOST_BYTES))
    try:
        read = trimesh.load(content, file_type=kind[1:], process=False, force="mesh")
        points = unit * np.asarray(read.vertices, np.float64).reshape(-1, 3)
        triangles = np.asarray(read.faces, np.int64).reshape(-1, 3)
    except Exception as error:  # noqa: BLE001 - a reader of files may raise anything
        wanted = f"a mesh of triangles ({type(error).__name__}: {error})"
        raise ConfigError.of(path, "mesh", None, wanted) from None
    return mend(points, triangles, str(path))


def mend(points: npt.ArrayLike, triangles: npt.ArrayLike, file: str = "mesh") -> Mesh:
    """Return a mesh of points (n, 3) m and triangles (m, 3), mended.

    Raises:
        ConfigError: it is refused: all faults.
        SkinbusError: trimesh is not installed.
    """
    p, t = np.asarray(points, np.float64), np.asarray(triangles, np.int64)
    if not len(t) or p.ndim != 2 or t.min(initial=0) < 0 or t.max(initial=0) >= len(p):
        raise ConfigError.of(file, "triangles", len(t), "at least one, of points that there are")
    if len(t) > MOST_TRIANGLES:
        wanted = f"at most {MOST_TRIANGLES}: simplify it, edges of 3 mm are enough"
        raise ConfigError.of(file, "triangles", len(t), wanted)
    if not np.isfinite(p[t]).all():
        raise ConfigError.of(file, "points", "NaN or infinite", "numbers")
    faults = FaultList()

    size = float(np.ptp(p[t.ravel()], axis=0).max())
    if not SIZES[0] <= size <= SIZES[1]:
        faults.add("size", f"{size:g} m", f"{SIZES[0]:g} to {SIZES[1]:g} m: say its unit")
    shape = _trimesh().Trimesh(p, t, process=False)
    shape.merge_vertices()
    shape.update_faces(shape.nondegenerate_faces())
    shape.update_faces(shape.unique_faces())
    p, t = np.array(shape.vertices), np.array(shape.faces, np.int64)
    if not len(t):
        raise ConfigError(file, [*faults, Fault("triangles", 0, "one with an area")])
    meeting = np.bincount(shape.edges_unique_inverse)
    for a, b in shape.edges_unique[meeting > 2]:
        where = (500.0 * (p[a] + p[b])).round(1).tolist()
        faults.add(f"edge at {where} mm", "3 or more triangles", "at most two at an edge")
    if shape.body_count > 1:
        faults.add("parts", shape.body_count, "one connected surface")
    elif not (meeting > 2).any() and not shape.is_winding_consistent:
        wanted = "triangles that are wound alike around an inside: mend it, in MeshLab for instance"
        faults.add("surface", "flipped triangles, or one side only", wanted)
    if faults:
        raise ConfigError(file, faults)
    if not rims_of(t) and shape.volume < 0.0:  # its normals point inward
        t = t[:, ::-1].copy()
    return Mesh(p, t)


def nearest_places(mesh: Mesh, wanted: Floats) -> tuple[Ints, Floats]:
    """Return the triangle (n,) nearest to each of (n, 3) points, and the weights (n, 3) of its corners."""
    tools, corners = _trimesh().triangles, mesh.points[mesh.triangles]
    tree = cKDTree(corners.mean(axis=1))
    near = np.array(tree.query(wanted, min(_NEAREST, len(corners)))[1], np.int64).reshape(len(wanted), -1)
    each = np.repeat(wanted, near.shape[1], axis=0)
    places = tools.closest_point(corners[near.ravel()], each)
    best = np.linalg.norm(places - each, axis=1).reshape(near.shape).argmin(axis=1)
    rows = np.arange(len(wanted))
    triangle = near[rows, best]
    return triangle, tools.points_to_barycentric(
        corners[triangle], places.reshape(*near.shape, 3)[rows, best]
    )


def refine(mesh: Mesh, longest: float) -> Mesh:
    """Return a mesh of the same shape whose edges are at most so long (m).

    In each round edges are halved that are the longest of all their triangles: one for each triangle.
    """
    points, triangles = mesh.points, mesh.triangles
    while True:
        every = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        edges, edge_of = np.unique(every, axis=0, return_inverse=True)
        edge_of = edge_of.reshape(-1, 3)
        length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        rank = np.argsort(np.argsort(length, kind="stable"))
        side = rank[edge_of].argmax(axis=1)
        own = edge_of[np.arange(len(triangles)), side]  # the longest edge of each triangle
        is_cut = (length > longest) & (np.bincount(own, minlength=len(edges)) == np.bincount(edge_of.ravel()))
        if not is_cut.any():
            return Mesh(points, triangles)
        middle = len(points) + np.cumsum(is_cut) - 1
        points = np.concatenate([points, points[edges[is_cut]].mean(axis=1)])
        halved = is_cut[own]
        turn = (side[halved, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(triangles[halved], turn, axis=1).T
        m = middle[own[halved]]
        triangles = np.concatenate([triangles[~halved], np.stack([a, m, c], -1), np.stack([m, b, c], -1)])


def sides_of(triangles: Ints) -> tuple[Ints, Ints, Ints]:
    """Return pairs of sides (3 t + k: corner k to the next) that are one edge, and those without a pair.

    The triangles are wound alike.
    """
    starts = triangles.ravel()
    ends = triangles[:, [1, 2, 0]].ravel()
    n = int(triangles.max()) + 1
    key, back = starts * n + ends, ends * n + starts
    order = np.argsort(key)
    partner = order[np.minimum(np.searchsorted(key[order], back), len(key) - 1)]
    paired = key[partner] == back
    sides = np.arange(len(key))
    once = paired & (sides < partner)
    return sides[once], partner[once], sides[~paired]


def rims_of(triangles: Ints) -> list[Ints]:
    """Return the corners of each open rim of triangles that are wound alike, in their order."""
    is_open = sides_of(triangles)[2]
    starts, ends = triangles.ravel()[is_open], triangles[:, [1, 2, 0]].ravel()[is_open]
    after = dict(zip(starts.tolist(), ends.tolist(), strict=True))
    rims = []
    while after:
        rim = [next(iter(after))]
        while (there := after.pop(rim[-1], None)) is not None and there != rim[0]:
            rim.append(there)
        rims.append(np.array(rim, np.int64))
    return rims


def length_of(points: Floats, rim: Ints) -> float:
    """Return how long a closed line through points is, m."""
    return float(np.linalg.norm(points[rim] - points[np.roll(rim, -1)], axis=1).sum())


def _trimesh() -> Any:
    with extra_wanted("mesh"):
        import trimesh
    return trimesh
