"""Boards laid onto the mesh of a link: where their tactels are, and the surface that kernels read.

A board that is placed by a point and a direction is laid onto the mesh by geodesics from there, one to each
tactel; of one whose tactels are given one by one, each is put on the nearest place of the mesh. Then all of
a link share one flat chart (``flattening``), so that a contact across a seam is one shape. How far places of
that chart are from a tactel is what geodesics from the tactel find, fitted by ``model.bend``.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from skinbus.errors import ConfigError, Fault, FaultList, SkinbusError
from skinbus.model.bend import EXPONENTS, MOST, POWERS
from skinbus.model.mesh_surface import MeshSurface
from skinbus.robot.flattening import Flattening, flatten
from skinbus.robot.mesh import Mesh, nearest_places, refine

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Arrays = dict[str, npt.NDArray[Any]]

STEP: Final = 2e-3
"""m, of the grid: see ``model.mesh_surface``."""
EDGE: Final = 5e-3
"""m: longer edges are divided; a tactel measures 5 to 10 mm."""
OFF: Final = 0.02
"""m: a board or a tactel further from the mesh is not meant to be on it."""
SCALES: Final = (0.75, 1.0 / 0.75)
"""Beyond these the scale changes so fast that distances of 10 mm err by a tenth."""
REACH: Final = 0.04
"""m, to which distances are fitted: the laws of covers of up to 10 mm end at 30 mm."""
_LENGTHS: Final = 0.005 * np.arange(1.0, 9.0)
"""m, of the geodesics from a tactel, up to ``REACH``."""
_ANGLES: Final = 2.0 * np.pi * np.arange(16) / 16
FLAT: Final = 1e-4
"""Part of a distance of 20 mm below which its correction is left out: 2 um. What can be unrolled
needs none."""
_FLAT_AT: Final = 0.02
_RANK: Final = 1e-3
"""Of singular values: what places beside a rim do not determine stays zero."""
_ON: Final = 1e-4
"""m, from the chart: beyond it a place is not on it."""
_KEPT: Final = b"4"
"""Of what is kept: another one where the method changes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Laid:
    """A board to be laid: by a point and a direction, or by the places of its tactels."""

    key: str
    """Where the file says so, for messages."""
    uv: Floats
    """(n, 2) m"""
    point: Floats | None = None
    """(3,) m, of its centre"""
    along: Floats | None = None
    """(3,) direction of u"""
    places: Floats | None = None
    """(n, 3) m, of its tactels"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OnChart:
    """A board on the chart: centre, turn, and its tactels (n, 12): s, a (m), scale, ``model.bend``."""

    s: float
    a: float
    yaw: float
    tactels: Floats


class Geodesics:
    """Straightest lines on a mesh: where one is after a length.

    Raises:
        SkinbusError: potpourri3d is not installed.
    """

    def __init__(self, mesh: Mesh) -> None:
        try:
            from potpourri3d import GeodesicTracer
        except ImportError as error:
            raise SkinbusError("a mesh needs potpourri3d: pip install 'skinbus[mesh]'") from error
        self.mesh = mesh
        self._tracer = GeodesicTracer(mesh.points, mesh.triangles)

    def axes(self, triangle: int, along: Floats | None = None) -> Floats:
        """Return directions (2, 3) in a triangle: along, projected, and to its left seen from outside.

        Raises:
            ValueError: the direction is along the normal.
        """
        (normal,) = self.mesh.normals(np.array([triangle]))
        if along is None:
            a, along = self.mesh.points[self.mesh.triangles[triangle, :2]]
            along = along - a
        flat = along - (along @ normal) * normal
        length = np.linalg.norm(flat)
        if not length > 1e-6 * np.linalg.norm(along):
            raise ValueError("a direction that is not along the normal of the mesh")
        return np.asarray(np.stack([flat, np.cross(normal, flat)]) / length)

    def shoot(self, triangle: int, weights: Floats, ways: Floats, lengths: Floats) -> Floats:
        """Return places (n, m, 3) m on geodesics from a place of a triangle; NaN beyond a rim.

        ways: (n, 3) m, directions in the triangle; lengths: (m,) parts of them
        """
        found = np.full((len(ways), len(lengths), 3), np.nan)
        for row, way in zip(found, ways, strict=True):
            length = float(np.linalg.norm(way))
            if not length:
                row[:] = self.mesh.at(np.array([triangle]), weights[None])
                continue
            line = self._tracer.trace_geodesic_from_face(triangle, weights, way)
            passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
            for x in range(3):
                row[:, x] = np.interp(lengths * length, passed, line[:, x])
            row[lengths * length > passed[-1] + 1e-9] = np.nan
        return found


def cache_folder() -> Path:
    """Return the folder where charts are kept, beside the compiled kernels of the user."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(given) if Path(given).is_absolute() else Path.home() / ".cache") / "skinbus" / "charts"


def lay(
    mesh: Mesh, boards: Sequence[Laid], name: str, kept: Path | None = None
) -> tuple[MeshSurface, list[OnChart]]:
    """Return the surface of a link and its boards on it.

    kept: folder where they are kept by their content

    Raises:
        ConfigError: a board is off the mesh, or they cannot share a chart: all faults.
        SkinbusError: trimesh or potpourri3d is not installed.
    """
    if kept is None:
        found = _compute(mesh, boards, name)
    else:
        digest = hashlib.sha256(_KEPT)
        for part in (mesh.points, mesh.triangles, *(_content(board) for board in boards)):
            digest.update(np.ascontiguousarray(part).tobytes())
        file = kept / f"link-{digest.hexdigest()}.npz"
        try:
            with np.load(file, allow_pickle=False) as data:
                found = dict(data)
        except (OSError, ValueError, KeyError, EOFError):
            found = _compute(mesh, boards, name)
            new = file.with_suffix(f".{os.getpid()}.npz")
            with suppress(OSError):  # what is not kept is computed again
                kept.mkdir(parents=True, exist_ok=True)
                np.savez(new, allow_pickle=False, **found)
                new.replace(file)
    ends = np.cumsum([len(board.uv) for board in boards])[:-1]
    rows = [
        OnChart(s=float(s), a=float(a), yaw=float(yaw), tactels=tactels)
        for (s, a, yaw), tactels in zip(found["boards"], np.split(found["tactels"], ends), strict=True)
    ]
    length, width, period = found["sizes"].tolist()
    scales, messages = found["tactels"][:, 2], mesh.messages
    if np.ptp(scales) > 0.01:
        stretch = f"the chart stretches by {scales.min():.3f} to {scales.max():.3f} under the boards"
        messages = (*messages, f"{stretch}: the mesh is curved in two directions")
    surface = MeshSurface(
        kind="mesh",
        length=length,
        radius=period / (2.0 * np.pi) if period else 1.0,
        taper=0.0,
        period=period,
        width=width,
        first=(0.0, float(found["first"])),
        step=STEP,
        nodes=found["nodes"],
        on=found["on"],
        points=mesh.points,
        triangles=mesh.triangles,
        messages=messages,
    )
    return surface, rows


def _content(board: Laid) -> Floats:
    """Return all numbers of a board: each kind has its own length."""
    parts = (board.uv, board.point, board.along, board.places)
    return np.concatenate([np.r_[np.size(part), np.ravel(part)] for part in parts if part is not None])


def _compute(mesh: Mesh, boards: Sequence[Laid], name: str) -> Arrays:
    fine, faults = refine(mesh, EDGE), FaultList()
    geodesics = Geodesics(fine)
    places = [_places(geodesics, board, faults) for board in boards]
    if faults:
        raise ConfigError(name, faults)
    chart = flatten(fine, np.concatenate(places), name=name)
    tactels = [_around(geodesics, chart, points) for points in places]
    scales = np.concatenate(tactels)[:, 2]
    if not (SCALES[0] <= scales.min() and scales.max() <= SCALES[1]):
        seen = f"{scales.min():.2f} to {scales.max():.2f}"
        wanted = (
            f"{SCALES[0]:.2f} to {SCALES[1]:.2f}: fewer boards, the others on another [[link]] of this mesh"
        )
        raise ConfigError(name, [Fault("scale of the chart", seen, wanted)])
    middles = []
    for board, rows in zip(boards, tactels, strict=True):  # as the board lies best on its tactels
        z, own = rows[:, 0] + 1j * rows[:, 1], board.uv[:, 0] + 1j * board.uv[:, 1]
        z = chart.nearest_turn(z, z[:1])
        turn = np.vdot(own - own.mean(), z - z.mean())
        centre = z.mean() - turn / (abs(turn) or 1.0) * own.mean()
        centre = complex(chart.nearest_turn(centre))
        middles.append((centre.real, centre.imag, np.angle(turn)))
    length, width = chart.place.real.max(), chart.period or np.ptp(chart.corners().imag)
    shape = int(np.ceil(length / STEP)) + 1, int(np.ceil(width / STEP)) + 1
    first = -0.5 * (shape[1] - 1) * STEP
    nodes, on = _grid(chart, first, shape)
    return {
        "boards": np.array(middles),
        "tactels": np.concatenate(tactels),
        "sizes": np.array([length, width, chart.period]),
        "first": np.array(first),
        "nodes": nodes,
        "on": on,
    }


def _places(geodesics: Geodesics, board: Laid, faults: list[Fault]) -> Floats:
    """Return where the tactels of a board are on a mesh, (n, 3) m; add faults."""
    mesh = geodesics.mesh
    wanted = board.point[None] if board.point is not None else board.places
    assert wanted is not None
    triangle, weights = nearest_places(mesh, wanted)
    found = mesh.at(triangle, weights)
    off = np.linalg.norm(found - wanted, axis=1)
    for k in np.flatnonzero(off > OFF)[:10]:
        seen = ", ".join(f"{1e3 * x:.1f}" for x in wanted[k])
        which = "xyz_mm" if board.point is not None else f"tactels {k + 1}"
        faults.append(Fault(f"{board.key}.{which}", seen, f"on the mesh; it is {1e3 * off[k]:.1f} mm away"))
    if board.along is None or (off > OFF).any():
        return found
    try:
        axes = geodesics.axes(triangle[0], board.along)
    except ValueError as error:
        faults.append(Fault(f"{board.key}.along", board.along.tolist(), str(error)))
        return found
    points = geodesics.shoot(triangle[0], weights[0], board.uv @ axes, np.ones(1))[:, 0]
    missing = int(np.isnan(points).any(axis=1).sum())
    if missing:
        what = f"{missing} of its tactels beyond the rim of the mesh"
        faults.append(Fault(f"{board.key}.xyz_mm", what, "a place where all are on it"))
    return points


def _locate(chart: Flattening, points: Floats) -> tuple[npt.NDArray[np.complex128], Floats]:
    """Return the places s + ia (n,) m on a chart nearest to points (n, 3) m, and how far they are off."""
    triangle, weights = nearest_places(chart.part, points)
    z = (weights * chart.corners()[triangle]).sum(axis=1)
    off = np.linalg.norm(chart.part.at(triangle, weights) - points, axis=1)
    return chart.nearest_turn(z), off


def _around(geodesics: Geodesics, chart: Flattening, tactels: Floats) -> Floats:
    """Return s, a (m), scale and bend (n, 12) of tactels (n, 3) m, by where geodesics from them end."""
    ways = REACH * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1)
    ends = []
    for triangle, weights in zip(*nearest_places(geodesics.mesh, tactels), strict=True):
        axes = geodesics.axes(triangle)
        ends.append(geodesics.shoot(triangle, weights, ways @ axes, _LENGTHS / REACH).reshape(-1, 3))
    places, _ = _locate(chart, tactels)
    there = np.where(np.isnan(ends), tactels[:, None], ends)
    z, off = (x.reshape(len(tactels), -1) for x in _locate(chart, there.reshape(-1, 3)))
    z = chart.nearest_turn(z - places[:, None])
    ratio = np.tile(_LENGTHS, len(_ANGLES)) / np.maximum(np.abs(z), 1e-9)
    is_on = ~np.isnan(ends)[..., 0] & (off < _ON) & (ratio < 2.0 * MOST)
    weight = np.tile(_LENGTHS, len(_ANGLES)) ** -0.5  # half way from equal parts to equal lengths
    terms = [(z.real / REACH) ** i * (z.imag / REACH) ** j * weight for i, j in ((0, 0), *EXPONENTS)]
    rows = []
    for place, columns, wanted, on in zip(places, np.stack(terms, -1), ratio * weight, is_on, strict=True):
        fitted = np.linalg.lstsq(columns[on], wanted[on], rcond=_RANK)[0]
        bend = fitted[1:] / fitted[0] / REACH**POWERS
        if np.abs(bend * _FLAT_AT**POWERS).max() < FLAT:
            bend[:] = 0.0
        rows.append([place.real, place.imag, round(1.0 / fitted[0], 5), *bend])
    return np.array(rows)


def _grid(chart: Flattening, first: float, shape: tuple[int, int]) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return the nodes (n_s, n_a, 6) of a grid on a chart, and which of them are on the mesh."""
    import trimesh

    points, triangles = chart.part.points, chart.part.triangles
    normals = trimesh.Trimesh(points, triangles, process=False).vertex_normals
    value, z = np.concatenate([points, normals], axis=1)[triangles], chart.corners()
    if chart.period:  # what lies over the ends is there once more
        z = np.concatenate([z, z - 1j * chart.period, z + 1j * chart.period])
        value = np.concatenate([value] * 3)
    corners = (np.stack([z.real, z.imag], -1) - (0.0, first)) / STEP
    low = np.maximum(np.ceil(corners.min(axis=1) - 1e-9).astype(int), 0)
    high = np.minimum(np.floor(corners.max(axis=1) + 1e-9).astype(int), np.array(shape) - 1)
    count = np.maximum(high - low + 1, 0)
    n = count.prod(axis=1)
    which = np.repeat(np.arange(len(n)), n)  # nodes in the rectangle around each triangle
    k = np.arange(len(which)) - np.repeat(np.cumsum(n) - n, n)
    node = low[which] + np.stack([k // count[which, 1], k % count[which, 1]], -1)
    a, b, c = np.moveaxis(corners[which], 1, 0)
    u, v, w = b - a, c - a, node - a
    det = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    x, y = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / det, (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / det
    weights = np.stack([1.0 - x - y, x, y], -1)
    inside = weights.min(axis=1) >= -1e-6
    at = tuple(node[inside].T)
    nodes, on = np.zeros((*shape, 6)), np.zeros(shape, np.bool_)
    on[at] = True
    nodes[at] = np.einsum("nk,nkx->nx", weights[inside], value[which[inside]])
    nearest = distance_transform_edt(~on, return_distances=False, return_indices=True)
    return np.ascontiguousarray(nodes[nearest[0], nearest[1]]), on
