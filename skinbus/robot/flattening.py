"""One flat chart of the part of a mesh that carries boards: conformal, and isometric where that can be.

The scale factors u of the corners make the cone angles of the mesh vanish: edges of length
``exp((u_i + u_j) / 2) l`` are those of a flat surface. With u = 0 along the rim the scale varies as little
as it can. A part that goes around the link has two rims; u is 0 on one and c on the other, with c such that
the flat surface closes as a cylinder does. Triangles are then unrolled one by one.

What can be unrolled (planes, cylinders, prisms) has no cone angles: u is 0, and flat distances are geodesic.
Assumption: boards cover a part that is a disc or a ring once holes of up to 100 mm around are closed.
Source: B. Springborn, P. Schroeder, U. Pinkall, Conformal equivalence of triangle meshes (2008), 3 (Newton's
method for u); M. Ben-Chen, C. Gotsman, G. Bunin, Conformal flattening by curvature prescription (2008).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from skinbus.arrays import Floats, Ints
from skinbus.errors import ConfigError
from skinbus.robot.mesh import Mesh, length_of, rims_of, sides_of

Complex = npt.NDArray[np.complex128]

REACH = 0.03
"""m, over which a chart goes on beyond tactels: the laws of covers of up to 10 mm end there."""
HOLE = 0.1
"""m around: less is a hole in a part, more may be the rim of a link of 32 mm and more in diameter."""
_BAY = HOLE / (2.0 * np.pi)
_ROUNDS = 20
_FLAT = 1e-10
"""rad, of the cone angles that are left: turns of the last triangle against the first by less than 1e-6."""


@dataclass(frozen=True, slots=True, eq=False)
class Flattening:
    """A chart of a part of a mesh: s and a (m) of its corners as s + ia, modulo i times the period.

    period  m, 0 of a chart that is not closed
    """

    part: Mesh
    place: Complex
    period: float

    def nearest_turn(self, z: Complex, to: Complex | complex = 0.0) -> Complex:
        """Return places a whole number of periods away, as near as can be to others."""
        if not self.period:
            return z
        return np.asarray(z - 1j * self.period * np.round((z - to).imag / self.period))

    def corners(self) -> Complex:
        """Return the places (m, 3) of the corners of each triangle, none of them cut apart."""
        z = self.place[self.part.triangles]
        return self.nearest_turn(z, z[:, :1])


def flatten(mesh: Mesh, skin: Floats, *, name: str = "mesh") -> Flattening:
    """Return the chart of the part of a mesh around tactels at ``skin`` (n, 3) m.

    s grows along the longest axis of the link frame that the part has; a is 0 where z is largest.

    Raises:
        ConfigError: the part is neither a disc nor a ring, or cannot be flattened.
    """
    part = _part(mesh, skin)
    used = np.unique(part)
    points, part = mesh.points[used], np.searchsorted(used, part)
    rims = sorted(rims_of(part), key=lambda rim: -length_of(points, rim))
    keep = 2 if len(rims) > 1 and length_of(points, rims[1]) >= HOLE else 1
    whole, corners = part, points
    for rim in rims[keep:]:  # a hole is closed by a fan
        centre = np.full(len(rim), len(corners))
        whole = np.concatenate([whole, np.stack([np.roll(rim, -1), rim, centre], -1)])
        corners = np.concatenate([corners, corners[rim].mean(axis=0)[None]])
    shared, _, single = sides_of(whole)
    euler = len(corners) - len(shared) - len(single) + len(whole)
    if not rims or euler != 2 - len(rims[:keep]):
        what = "a closed surface" if not rims else f"{len(rims)} rims, Euler characteristic {euler}"
        raise ConfigError.of(name, "skin", what, "boards on a part that is a disc or a ring")
    u = _scale_factors(corners, whole, rims[:keep], name)
    placed, closes = _unroll(whole, _lengths(corners, whole, u))
    z = np.empty(len(corners), np.complex128)
    z[whole.ravel()] = placed.ravel()
    unit = np.exp(-u[cKDTree(points).query(skin)[1]].mean())
    return _turned(Mesh(points, part), unit * z[: len(points)], unit * closes)


def _part(mesh: Mesh, skin: Floats) -> Ints:
    """Return the triangles within reach of tactels along the mesh; more, so that they are one surface."""
    points, triangles = mesh.points, mesh.triangles
    start, end = (triangles[:, k].ravel() for k in ([0, 1, 2], [1, 2, 0]))
    length = np.linalg.norm(points[start] - points[end], axis=1)
    graph = csr_array((length, (start, end)), (len(points), len(points)))
    # an edge of two triangles is there in both directions, once each
    sources = np.unique(cKDTree(points).query(skin)[1])

    def away_from(corners: Any) -> Floats:
        return np.asarray(dijkstra(graph, directed=False, indices=corners, min_only=True))

    away, reach = away_from(sources), REACH
    while True:
        # bays and holes that are narrow are filled: what is far from all that is far away belongs to it
        far = np.flatnonzero(away > reach + _BAY)
        near = (away <= reach) | (away_from(far) > _BAY if len(far) else True)
        part = triangles[near[triangles].any(axis=1)]
        first, second, is_open = sides_of(part)
        neighbours = csr_array((np.ones(len(first)), (first // 3, second // 3)), (len(part), len(part)))
        rim_starts = part.ravel()[is_open]
        # one piece, and no corner where two fans of triangles touch: a rim goes through it once
        is_one = connected_components(neighbours, directed=False)[0] == 1
        if len(part) == len(triangles) or (is_one and len(np.unique(rim_starts)) == len(rim_starts)):
            return part
        reach *= 1.5


def _lengths(points: Floats, triangles: Ints, u: Floats) -> Floats:
    """Return the lengths (m, 3) of the sides opposite to the corners under scale factors u."""
    i, j = triangles[:, [1, 2, 0]], triangles[:, [2, 0, 1]]
    return np.asarray(np.exp(0.5 * (u[i] + u[j])) * np.linalg.norm(points[i] - points[j], axis=2))


def _angles(sides: Floats) -> Floats:
    """Return the angles (m, 3) of triangles of these sides, each opposite to its side."""
    a, b, c = sides, sides[:, [1, 2, 0]], sides[:, [2, 0, 1]]
    return np.asarray(np.arccos(np.clip((b * b + c * c - a * a) / (2.0 * b * c), -1.0, 1.0)))


def _scale_factors(points: Floats, triangles: Ints, rims: list[Ints], name: str) -> Floats:
    """Return the scale factors (n,) with which a surface with one rim or two is flat."""
    n = len(points)
    full_turn = np.full(n, 2.0 * np.pi)
    full_turn[np.concatenate(rims)] = np.pi
    inner = np.flatnonzero(full_turn > np.pi)
    # one unknown for each inner corner, and one for all of the second rim
    second = rims[1] if len(rims) == 2 else np.zeros(0, np.int64)
    columns = np.concatenate([np.arange(len(inner)), np.full(len(second), len(inner))])
    rows = np.concatenate([inner, second])
    spread = csr_array((np.ones(len(rows)), (rows, columns)), (n, len(inner) + len(rims) - 1))
    i, j = triangles[:, [1, 2, 0]].ravel(), triangles[:, [2, 0, 1]].ravel()
    u = np.zeros(n)
    for _ in range(_ROUNDS):
        angles = _angles(_lengths(points, triangles, u))
        wrong = spread.T @ (full_turn - np.bincount(triangles.ravel(), angles.ravel(), n))
        if np.abs(wrong).max(initial=0.0) < _FLAT:
            return u
        half = 0.5 / np.tan(np.clip(angles.ravel(), 1e-3, np.pi - 1e-3))
        # the sums of rows are put in as further entries: those of one place add up
        weights = np.concatenate([-half, -half, half, half])
        places = np.concatenate([i, j, i, j]), np.concatenate([j, i, i, j])
        laplacian = csr_array((weights, places), (n, n))
        try:
            step: Any = spread @ splu(csc_array(spread.T @ laplacian @ spread)).solve(-wrong)
        except RuntimeError:  # singular
            break
        u = u + step / max(1.0, 2.0 * float(np.abs(step).max(initial=0.0)))
    wanted = "a mesh without holes and creases there, or fewer boards on it"
    raise ConfigError.of(name, "skin", "a part that cannot be flattened", wanted)


def _unroll(triangles: Ints, sides: Floats) -> tuple[Complex, complex]:
    """Return the corners (m, 3) of triangles of these sides in the plane, and what closes the chart, or 0."""
    own = np.zeros((len(triangles), 3), np.complex128)
    own[:, 1] = sides[:, 2]
    own[:, 2] = sides[:, 1] * np.exp(1j * _angles(sides)[:, 0])
    first, second, _ = sides_of(triangles)
    both = np.concatenate([first, second]), np.concatenate([second, first])
    side_to = csr_array((both[0] + 1, (both[0] // 3, both[1] // 3)), (len(triangles), len(triangles)))
    partner = dict(zip(*(x.tolist() for x in both), strict=True))
    order, before = breadth_first_order(side_to, 0, directed=False)
    out_of = np.asarray(side_to[before[order[1:]], order[1:]]).ravel().astype(int) - 1
    placed = own.copy()
    for t, p, side in zip(order[1:].tolist(), before[order[1:]].tolist(), out_of.tolist(), strict=True):
        start, end, k = placed[p, side % 3], placed[p, (side + 1) % 3], partner[side] % 3
        turn = (start - end) / (own[t, (k + 1) % 3] - own[t, k])
        placed[t] = end + turn * (own[t] - own[t, k])
    apart = placed[first // 3, first % 3] - placed[second // 3, (second + 1) % 3]
    far = apart[np.abs(apart) > 0.5 * float(sides.mean())]
    if not len(far):
        return placed, 0.0
    least = far[np.abs(far).argmin()]
    return placed, complex(np.mean(far * np.sign((far * least.conjugate()).real)))


def _turned(part: Mesh, z: Complex, closes: complex) -> Flattening:
    """Return the chart with s and a as real and imaginary part."""
    off = z - z.mean()
    slope = np.linalg.lstsq(np.stack([off.real, off.imag], -1), part.points - part.points.mean(axis=0))[0]
    rises = slope[0] + 1j * slope[1]  # of x, y and z: along these directions
    along = -1j * closes
    if closes:
        rise = (rises * along.conjugate()).real
        along *= np.sign(rise[np.abs(rise).argmax()])
    else:
        along = rises[np.round(np.abs(rises), 6).argmax()]  # of axes that are alike the first one
    z = z * (along.conjugate() / abs(along))
    chart = Flattening(part, z, abs(closes))
    if closes:
        z = chart.nearest_turn(z - 1j * z[part.points[:, 2].argmax()].imag)
    else:
        z = z - 0.5j * (z.imag.min() + z.imag.max())
    return Flattening(part, z - z.real.min(), abs(closes))
