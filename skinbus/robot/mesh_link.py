"""Boards laid onto the mesh of a link: where their tactels are, and the surface that kernels read.

A board that is placed by a point and a direction is laid onto the mesh by its own chart (``mesh_chart``); of
one whose tactels are given one by one, each is put on the nearest place of the mesh. Then all of a link share
one flat chart (``flattening``), so that a contact across a seam is one shape.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.model.mesh_surface import MeshSurface
from skinbus.robot.chart_metric import ChartMetric
from skinbus.robot.flattening import EDGE, Flattening, flatten, refine
from skinbus.robot.mesh import Mesh
from skinbus.robot.mesh_chart import chart_at, nearest_places

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

STEP: Final = 2e-3
"""m, of the grid: see ``model.mesh_surface``."""
OFF: Final = 0.02
"""m: a board or a tactel further from the mesh is not meant to be on it."""
TURNED: Final = 0.5
"""Cosine between the normal that is said of a tactel and that of the mesh: 60 degrees are not a tolerance."""
_KEPT: Final = b"2"
"""Of the charts that are kept: another one where the method changes."""


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
    normals: Floats | None = None
    """(n, 3) outward, or None"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OnChart:
    """A board on the chart: centre, turn, and its tactels (n, 12): s, a (m), scale, ``model.bend``."""

    s: float
    a: float
    yaw: float
    tactels: Floats


def cache_folder() -> Path:
    """Return the folder where charts are kept, beside the compiled kernels of the user."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(given) if Path(given).is_absolute() else Path.home() / ".cache") / "skinbus" / "charts"


def lay(
    mesh: Mesh, boards: Sequence[Laid], name: str, kept: Path | None = None
) -> tuple[MeshSurface, list[OnChart]]:
    """Return the surface of a link and its boards on it.

    kept: folder where charts are kept by their content

    Raises:
        ConfigError: a board is off the mesh, or they cannot share a chart: all faults.
        SkinbusError: trimesh or potpourri3d is not installed.
    """
    fine, faults = refine(mesh), FaultList()
    places = [_places(fine, board, faults, kept) for board in boards]
    if faults:
        raise ConfigError(name, faults)
    skin = np.concatenate([points for points, _ in places])
    chart = _chart(fine, skin, name, kept)
    rows: list[OnChart] = []
    metric = ChartMetric(chart)
    for board, (points, marks) in zip(boards, places, strict=True):
        tactels, cross = metric.around(_locate(chart, points)), _locate(chart, marks)
        z = tactels[:, 0] + 1j * tactels[:, 1]
        own = board.uv[:, 0] + 1j * board.uv[:, 1]
        if board.point is not None:  # a cross of known directions
            z, own = cross[:, 0] + 1j * cross[:, 1], _CROSS[:, 0] + 1j * _CROSS[:, 1]
        if chart.period:
            z = z - 1j * chart.period * np.round((z.imag - z.imag[0]) / chart.period)
        centre = z.mean()
        turn = np.vdot(own - own.mean(), z - centre)
        centre -= turn / (abs(turn) or 1.0) * own.mean()
        a = centre.imag - (chart.period * np.round(centre.imag / chart.period) if chart.period else 0.0)
        rows.append(OnChart(s=centre.real, a=float(a), yaw=float(np.angle(turn)), tactels=tactels))
    return _surface(mesh, chart, rows), rows


_CROSS: Final = 2e-3 * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


def _places(mesh: Mesh, board: Laid, faults: list[Fault], kept: Path | None) -> tuple[Floats, Floats]:
    """Return where the tactels of a board are on a mesh (n, 3) m, and a cross about its centre, or faults."""
    wanted = board.point[None] if board.point is not None else board.places
    assert wanted is not None
    triangle, weights = nearest_places(mesh.points, mesh.triangles, wanted)
    found = np.einsum("nk,nkx->nx", weights, mesh.points[mesh.triangles[triangle]])
    off = np.linalg.norm(found - wanted, axis=1)
    for k in np.flatnonzero(off > OFF)[:10]:
        seen = ", ".join(f"{1e3 * x:.1f}" for x in wanted[k])
        which = "xyz_mm" if board.point is not None else f"tactels {k + 1}"
        faults.append(Fault(f"{board.key}.{which}", seen, f"on the mesh; it is {1e3 * off[k]:.1f} mm away"))
    if (off > OFF).any():
        return found, found
    if board.point is None:
        if board.normals is not None:
            turned = np.flatnonzero((mesh.normals[triangle] * board.normals).sum(axis=1) < TURNED)
            for k in turned[:10]:
                seen = ", ".join(f"{x:.2f}" for x in board.normals[k])
                wish = ", ".join(f"{x:.2f}" for x in mesh.normals[triangle[k]])
                faults.append(
                    Fault(f"{board.key}.tactels {k + 1}", f"normal {seen}", f"that of the mesh, {wish}")
                )
        return found, found
    assert board.along is not None
    reach = float(np.linalg.norm(board.uv, axis=1).max()) + EDGE
    try:
        chart = chart_at(mesh, board.point, board.along, reach=reach, kept=kept)
    except ValueError as error:
        faults.append(Fault(f"{board.key}.along", board.along.tolist(), str(error)))
        return found, found
    except RuntimeError as error:  # of potpourri3d
        where = f"a place around which the mesh is a surface ({error})"
        faults.append(Fault(f"{board.key}.xyz_mm", None, where))
        return found, found
    points, _ = chart.lift(np.concatenate([board.uv, _CROSS]))
    missing = np.isnan(points).any(axis=1)
    if missing.any():
        what = f"{int(missing.sum())} of its tactels beyond the rim of the mesh, or in a crease"
        faults.append(Fault(f"{board.key}.xyz_mm", what, "a place where all are on it"))
    return points[: len(board.uv)], points[len(board.uv) :]


def _chart(mesh: Mesh, skin: Floats, name: str, kept: Path | None) -> Flattening:
    """Return the chart of a link, kept by content."""
    if kept is None:
        return flatten(mesh, skin, name=name)
    digest = hashlib.sha256(_KEPT)
    content: tuple[npt.NDArray[Any], ...] = (mesh.points, mesh.triangles, skin)
    for array in content:
        digest.update(np.ascontiguousarray(array).tobytes())
    file = kept / f"link-{digest.hexdigest()}.npz"
    try:
        with np.load(file, allow_pickle=False) as data:
            return Flattening(
                data["points"], data["triangles"], data["corners"], data["scale"], float(data["period"])
            )
    except (OSError, ValueError, KeyError, EOFError):
        pass
    chart = flatten(mesh, skin, name=name)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        new = file.with_suffix(f".{os.getpid()}.npz")
        np.savez(
            new,
            points=chart.points,
            triangles=chart.triangles,
            corners=chart.corners,
            scale=chart.scale,
            period=chart.period,
        )
        new.replace(file)
    except OSError:
        pass  # a chart that is not kept is computed again
    return chart


def _locate(chart: Flattening, points: Floats) -> Floats:
    """Return s, a (m) (n, 2) of places of the chart nearest to points (n, 3) m."""
    triangle, weights = nearest_places(chart.points, chart.triangles, points)
    place = np.einsum("nk,nkx->nx", weights, chart.corners[triangle])
    if chart.period:
        place[:, 1] -= chart.period * np.round(place[:, 1] / chart.period)
    return np.asarray(place)


def _surface(mesh: Mesh, chart: Flattening, boards: Sequence[OnChart]) -> MeshSurface:
    corners, period = chart.corners, chart.period
    length = float(corners[..., 0].max())
    width = period or float(np.ptp(corners[..., 1]))
    half = 0.5 * width
    n_s, n_a = int(np.ceil(length / STEP)) + 1, int(np.ceil(width / STEP)) + 1
    first = (0.0, -0.5 * (n_a - 1) * STEP)
    nodes, on = _grid(chart, first, (n_s, n_a))
    scales = np.concatenate([board.tactels[:, 2] for board in boards])
    messages = list(mesh.messages)
    if np.ptp(scales) > 0.01:
        messages.append(
            f"the chart stretches by {scales.min():.3f} to {scales.max():.3f} under the boards: "
            "the mesh is curved in two directions"
        )
    return MeshSurface(
        kind="mesh",
        length=length,
        radius=period / (2.0 * np.pi) if period else 1.0,
        taper=0.0,
        period=period,
        width=2.0 * half,
        first=first,
        step=STEP,
        nodes=nodes,
        on=on,
        points=mesh.points,
        triangles=mesh.triangles,
        messages=tuple(messages),
    )


def _grid(
    chart: Flattening, first: tuple[float, float], shape: tuple[int, int]
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return the nodes (n_s, n_a, 6) of a grid on a chart, and which of them are on the mesh."""
    a, b, c = (chart.points[chart.triangles[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    smooth = np.zeros_like(chart.points)
    for k in range(3):
        np.add.at(smooth, chart.triangles[:, k], flat)
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1), 1e-30)[:, None]
    value = np.concatenate([chart.points, smooth], axis=1)[chart.triangles]
    place = (chart.corners - np.array(first)) / STEP
    if chart.period:  # what lies over the ends is there once more
        turn = chart.period / STEP
        over = np.array([0.0, turn])
        place = np.concatenate([place, place - over, place + over])
        value = np.concatenate([value] * 3)
    low = np.maximum(np.ceil(place.min(axis=1) - 1e-9).astype(int), 0)
    high = np.minimum(np.floor(place.max(axis=1) + 1e-9).astype(int), np.array(shape) - 1)
    count = np.maximum(high - low + 1, 0)
    n = count.prod(axis=1)
    which = np.repeat(np.arange(len(n)), n)
    k = np.arange(len(which)) - np.repeat(np.cumsum(n) - n, n)
    i, j = low[which, 0] + k // count[which, 1], low[which, 1] + k % count[which, 1]
    a, b, c = (place[which, m] for m in range(3))
    u, v, w = b - a, c - a, np.stack([i, j], -1) - a
    det = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    x, y = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / det, (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / det
    inside = np.minimum(np.minimum(x, y), 1.0 - x - y) >= -1e-6
    i, j, which, x, y = (array[inside] for array in (i, j, which, x, y))
    nodes, on = np.zeros((*shape, 6)), np.zeros(shape, np.bool_)
    on[i, j] = True
    nodes[i, j] = np.einsum("nk,nkx->nx", np.stack([1.0 - x - y, x, y], -1), value[which])
    nearest = distance_transform_edt(~on, return_distances=False, return_indices=True)
    return np.ascontiguousarray(nodes[nearest[0], nearest[1]]), on
