"""Boards laid onto the mesh of a link: where their tactels are, and the surface that kernels read.

A board is placed by a point and a direction, and laid onto the mesh by geodesics from there, one to each
tactel. Then all of a link share one flat chart (``flattening``), so that a contact across a seam is one
shape. How far places of that chart are from a tactel is what geodesics from the tactel find, fitted by
``model.bend``.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bools, Floats
from skinbus.errors import ConfigError, FaultList, extra_wanted
from skinbus.model.bend import EXPONENTS, MOST, POWERS
from skinbus.model.mesh_surface import MeshSurface
from skinbus.robot.flattening import Complex, Flattening, flatten
from skinbus.robot.mesh import Mesh, nearest_places, refine

Arrays = dict[str, npt.NDArray[Any]]

STEP = 2e-3
"""m, of the grid: see ``model.mesh_surface``."""
EDGE = 5e-3
"""m: longer edges are divided; a tactel measures 5 to 10 mm."""
OFF = 0.02
"""m: a board or a tactel further from the mesh is not meant to be on it."""
SCALES = (0.75, 1.0 / 0.75)
"""Beyond these the scale changes so fast that distances of 10 mm err by a tenth."""
REACH = 0.04
"""m, to which distances are fitted: the laws of covers of up to 10 mm end at 30 mm."""
_LENGTHS = 0.005 * np.arange(1.0, 9.0)
"""m, of the geodesics from a tactel, up to ``REACH``."""
_ANGLES = 2.0 * np.pi * np.arange(16) / 16
FLAT = 1e-4
"""Part of a distance of 20 mm below which its correction is left out: 2 um. What can be unrolled
needs none."""
_FLAT_AT = 0.02
_RANK = 1e-3
"""Of singular values: what places beside a rim do not determine stays zero."""
_ON = 1e-4
"""m, from the chart: beyond it a place is not on it."""
_ROUNDING = 1e-9
"""m, of a place that is on the mesh."""
_KEPT = b"6"
"""Of what is kept: another one where the method changes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Laid:
    """A board to be laid, by a point and a direction."""

    key: str
    """Where the file says so, for messages."""
    uv: Floats
    """(n, 2) m"""
    point: Floats
    """(3,) m, of its centre"""
    along: Floats
    """(3,) direction of u"""


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
        with extra_wanted("mesh"):
            from potpourri3d import GeodesicTracer
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
        of_boards = (np.concatenate([b.point, b.along, b.uv.ravel()]) for b in boards)
        for part in (mesh.points, mesh.triangles, *of_boards):
            digest.update(part.tobytes())
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
    length, width, period, first = found["sizes"].tolist()
    surface = MeshSurface(
        kind="mesh",
        length=length,
        radius=period / (2.0 * np.pi) if period else 1.0,
        taper=0.0,
        period=period,
        width=width,
        first=(0.0, first),
        step=STEP,
        nodes=found["nodes"],
        on=found["on"],
        points=mesh.points,
        triangles=mesh.triangles,
    )
    return surface, rows


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
        raise ConfigError.of(name, "scale of the chart", seen, wanted)
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
        "sizes": np.array([length, width, chart.period, first]),
        "nodes": nodes,
        "on": on,
    }


def _places(geodesics: Geodesics, board: Laid, faults: FaultList) -> Floats:
    """Return where the tactels of a board are on a mesh, (n, 3) m; add faults."""
    triangle, weights = nearest_places(geodesics.mesh, board.point[None])
    off = float(np.linalg.norm(geodesics.mesh.at(triangle, weights) - board.point))
    if off > OFF:
        seen = (1e3 * board.point).round(1).tolist()
        faults.add(f"{board.key}.xyz_mm", seen, f"on the mesh; it is {1e3 * off:.1f} mm away")
        return board.uv
    try:
        axes = geodesics.axes(triangle[0], board.along)
    except ValueError as error:
        faults.add(f"{board.key}.along", board.along.tolist(), str(error))
        return board.uv
    points = geodesics.shoot(triangle[0], weights[0], board.uv @ axes, np.ones(1))[:, 0]
    missing = int(np.isnan(points).any(axis=1).sum())
    if missing:
        what = f"{missing} of its tactels beyond the rim of the mesh"
        faults.add(f"{board.key}.xyz_mm", what, "a place where all are on it")
    return points


def _locate(chart: Flattening, points: Floats) -> tuple[Complex, Floats]:
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


def _grid(chart: Flattening, first: float, shape: tuple[int, int]) -> tuple[Floats, Bools]:
    """Return the nodes (n_s, n_a, 6) of a grid on a chart, and which of them are on the mesh."""
    import trimesh

    points, triangles = chart.part.points, chart.part.triangles
    normals = trimesh.Trimesh(points, triangles, process=False).vertex_normals
    value, z = np.concatenate([points, normals], axis=1)[triangles], chart.corners()
    if chart.period:  # what lies over the ends is there once more
        z = np.concatenate([z, z - 1j * chart.period, z + 1j * chart.period])
        value = np.concatenate([value] * 3)
    flat = Mesh(
        np.stack([z.real, z.imag, np.zeros(z.shape)], -1).reshape(-1, 3), np.arange(z.size).reshape(-1, 3)
    )
    s, a = STEP * np.indices(shape)
    wanted = np.stack([s, first + a, np.zeros(shape)], -1).reshape(-1, 3)
    triangle, weights = nearest_places(flat, wanted)
    nodes = np.einsum("nk,nkx->nx", weights, value[triangle])
    on = np.linalg.norm(flat.at(triangle, weights) - wanted, axis=1) < _ROUNDING
    return nodes.reshape(*shape, 6), on.reshape(shape)
