"""Arm and boards of an iCub's skin, from its file of positions: each triangle becomes a patch.

A file has lines ``name``, ``spatial_sampling``, ``taxel2Repr (...)`` and ``[calibration]``, then a row
``x y z nx ny nz`` (m, in the frame of the link) for each of 12 readings of 16 triangles of each board. Rows
of zeros are no tactels, nor are those with -1 in ``taxel2Repr``; those with another number repeat that row.

A link has one surface: the plane or the cylinder nearest to its tactels, or a mesh that the user gives.
Source: robotology/icub-main, app/skinGui/conf/positions; never tried with a robot.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from skinbus.arrays import Bools, Floats
from skinbus.config.placement import keys_of
from skinbus.errors import ConfigError, FaultList
from skinbus.file_bytes import read_bytes
from skinbus.gateway.positions import lay_flat
from skinbus.model import Surface
from skinbus.objects.new_board import NewBoard

MAX_BYTES = 1 << 20
"""Sixteen boards of 192 rows with 50 characters are a sixth of this."""
ROWS = 12
"""Of a triangle."""
TACTELS = (0, 1, 2, 3, 4, 5, 7, 8, 9, 11)
"""Rows of a triangle that measure pressure; 6 and 10 are its thermal pads."""
TRIANGLES = 16
"""Of a board."""
MARGIN = 0.02
"""m of a surface beyond its tactels: a board may reach so far."""
BETTER = 0.5
"""Share of the residual of a plane to which a cylinder must come: it has two numbers more."""
CONVERTER_BITS = 8
RATE_HZ = 1500.0
"""Of one triangle alone, whose three frames take 0.4 ms, on 60 % of the bus."""
RIM_UM = 100
"""Of a board around its tactels: nothing is known of it, and triangles stand close."""


class Positions(NamedTuple):
    """Tactels of one link."""

    name: str
    points: Floats
    """(n_triangles, 10, 3) m, in the frame of the link."""
    normals: Floats
    """(n_triangles, 10, 3) outward, of any length."""
    healthy: Bools
    """(n_triangles, 10) False where there is no tactel."""


class Fit(NamedTuple):
    """A surface through points."""

    surface: Surface
    X_LS: Floats
    """(4, 4) pose of its frame in that of the link."""
    sa: Floats
    """(n, 2) m, chart coordinates of the points."""
    off: Floats
    """(n,) m, how far each is over the surface."""

    @property
    def rms(self) -> float:
        """Residual, m."""
        return float(np.sqrt(np.mean(self.off**2)))


def read_positions(path: Path) -> Positions:
    """Return the tactels in a file.

    Raises:
        ConfigError: faults of the file, all of them.
    """
    text = read_bytes(path, MAX_BYTES).decode("utf-8", errors="replace")
    faults, rows = FaultList(), list[list[float]]()
    name = re.search(r"(?m)^name\s+(\w+)", text)
    stands_for = re.search(r"(?m)^taxel2Repr\s*\(([-\d\s]*)\)", text)
    for number, line in enumerate(text.splitlines(), 1):
        if not re.match(r"\s*[-+.\d]", line):
            continue
        try:
            row = [float(word) for word in line.split()]
        except ValueError:
            row = []
        if len(row) != 6 or not np.abs(row).max() < 10.0:
            faults.add(f"line {number}", line.strip()[:60], "x y z nx ny nz, m")
        rows.append(row)
    own = np.arange(len(rows))
    of = own if stands_for is None else np.array(re.findall(r"(?<!\S)-?\d{1,9}(?!\S)", stands_for[1]), int)
    if not rows or len(rows) % ROWS:
        faults.add("rows", len(rows), f"{ROWS} for each triangle")
    if len(of) != len(rows):
        faults.add("taxel2Repr", f"{len(of)} numbers", f"{len(rows)}, one for each row")
    if faults:
        raise ConfigError(path, faults)
    table = np.array(rows)
    used = (of == own) & table[:, :3].any(axis=1) & table[:, 3:].any(axis=1)
    if not used.any():
        raise ConfigError.of(path, "rows", "no tactel", "positions that are not zero")
    cut = table.reshape(-1, ROWS, 6)[:, TACTELS]
    is_tactel = used.reshape(-1, ROWS)[:, TACTELS]
    return Positions(name[1] if name else path.stem, cut[..., :3], cut[..., 3:], is_tactel)


def fit_surface(points: Floats, normals: Floats) -> Fit:
    """Return the plane or the cylinder that is nearest to points with outward normals.

    The axis of the cylinder is across the normals, its centre is where they meet; least squares refine both.

    Args:
        points:  (n, 3) m.
        normals: (n, 3) of any length.
    """
    middle, units = points.mean(0), normals / np.linalg.norm(normals, axis=1, keepdims=True)
    longest, _, up = np.linalg.svd(points - middle)[2]
    flat = _fit("plane", points, longest, up * np.copysign(1.0, up @ units.sum(0)), middle)

    axis = np.linalg.eigh(units.T @ units)[1][:, 0]
    across = np.linalg.svd(axis[None])[2][1:]
    q, m = points @ across.T, units @ across.T
    centre_and_radius = np.linalg.lstsq(
        np.column_stack([np.tile(np.eye(2), (len(q), 1)), m.ravel()]), q.ravel(), rcond=None
    )[0]

    def line(x: Floats) -> tuple[Floats, Floats]:
        return (axis + x[3:] @ across) / math.hypot(1.0, *x[3:]), x[:2] @ across

    def off(x: Floats) -> Floats:
        along, through = line(x)
        return np.asarray(np.linalg.norm(np.cross(points - through, along), axis=1) - x[2])

    best = least_squares(off, [*centre_and_radius, 0.0, 0.0], x_scale=[0.1, 0.1, 0.1, 1.0, 1.0]).x
    if best[2] <= 0.0 or np.mean(off(best) ** 2) > (BETTER * flat.rms) ** 2:
        return flat
    along, through = line(best)
    towards = middle - through - along * ((middle - through) @ along)
    return _fit("cylinder", points, along, towards, through, best[2])


def _fit(kind: str, points: Floats, x: Floats, z: Floats, through: Floats, radius: float = 0.0) -> Fit:
    """Return a surface with its frame: x along it, z outward, the origin at its end."""
    x = x * np.copysign(1.0, x[np.abs(x).argmax()])
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    X_LS = np.eye(4)
    X_LS[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    s = (points - through) @ x
    X_LS[:3, 3] = through + (s.min() - MARGIN) * x
    local, length = (points - X_LS[:3, 3]) @ X_LS[:3, :3], float(np.ptp(s)) + 2.0 * MARGIN
    surface = Surface.plane(length, 2.0 * float(np.abs(local[:, 1]).max() + MARGIN))
    if kind == "cylinder":
        surface = Surface.cylinder(length, radius)
    s, a, over = surface.project(local)
    return Fit(surface, X_LS, np.column_stack([s, a]), over)


def import_skin(skin: Positions, *, first_board: int, mesh: str | None) -> tuple[dict[str, str], Fit]:
    """Return the text of an arm file and of the EDS files beside it, by name, and the surface of the link.

    Args:
        first_board: address of the board whose triangles come first in the file.
        mesh: file of a mesh in the frame of the link, on which the boards are laid in place of the surface.
    """
    used = np.flatnonzero(skin.healthy.any(axis=1)).tolist()
    points = skin.points[skin.healthy]
    fit = fit_surface(points, skin.normals[skin.healthy])
    distances = np.asarray(cKDTree(points).query(points, [2])[0])  # the nearest of a tactel is itself
    pitch = max(1e-3, float(np.median(distances)))
    files, tables = dict[str, str](), list[str]()
    rows = np.cumsum(skin.healthy).reshape(skin.healthy.shape) - 1
    for node_id, k in enumerate(used, 1):
        mine, address = skin.healthy[k], f"{first_board + k // TRIANGLES}.{k % TRIANGLES}"
        if mesh is None:
            sa = fit.sa[rows[k][mine]]
            middle = 0.5 * (sa.max(0) + sa.min(0))
            uv = sa - middle
            keys = "\n".join(f"{key} = {value:.3f}" for key, value in keys_of(fit.surface, *middle).items())
        else:
            uv, centre, along = lay_flat(skin.points[k][mine], skin.normals[k][mine])
            keys = f"xyz_mm = {_triple(1e3 * centre)}\nalong = {_triple(along)}"
        tactels = np.zeros((len(TACTELS), 2))
        tactels[mine] = uv
        eds = NewBoard(name=f"{address}.eds", tactels_uv=tactels, pitch=pitch, bits=16).eds()
        width, height = 2e6 * np.abs(uv).max(0) + RIM_UM
        values = {"2000sub2": width, "2000sub3": height, "2010sub2": CONVERTER_BITS}
        values["2040"] = mine @ (1 << np.arange(len(mine)))
        for section, value in values.items():
            eds.put(section, "DefaultValue", round(value))
        files[f"{address}.eds"] = eds.text()
        tables.append(
            f'[[patch]]\nnode_id = {node_id}\nlink = "{skin.name}"\neds = "{address}.eds"\n'
            f'address = "{address}"\n{keys}\n'
        )
    link = _link(fit) if mesh is None else f'surface = "mesh"\nmesh = "{mesh}"\n'
    rate_hz = min(50.0, RATE_HZ // len(used))
    head = f'[arm]\nname = "{skin.name}"\nrate_hz = {rate_hz}\n\n[[link]]\nname = "{skin.name}"\n{link}'
    return {f"{skin.name}.toml": "\n".join([head, *tables])} | files, fit


def _link(fit: Fit) -> str:
    surface, rpy = fit.surface, Rotation.from_matrix(fit.X_LS[:3, :3]).as_euler("xyz", degrees=True)
    across = f"width_mm = {1e3 * surface.width:.3f}"
    if surface.period:
        across = f"radius_mm = {1e3 * surface.radius:.3f}"
    return (
        f'surface = "{surface.kind}"\nlength_mm = {1e3 * surface.length:.3f}\n{across}\n'
        f"# with [robot]:\n# xyz_mm = {_triple(1e3 * fit.X_LS[:3, 3])}\n# rpy_deg = {_triple(rpy)}\n"
    )


def _triple(values: Sequence[float] | Floats) -> str:
    return f"[{', '.join(f'{value:.4f}' for value in values)}]"
