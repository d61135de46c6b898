"""One flat chart of the part of a mesh that carries boards: conformal, and isometric where that can be.

The scale factors u of the corners make the cone angles of the mesh vanish: edges of length
``exp((u_i + u_j) / 2) l`` are those of a flat surface. With u = 0 along the rim the scale varies as little
as it can. A part that goes around the link has two rims; u is 0 on one and c on the other, with c such that
the flat surface closes as a cylinder does. Triangles are then unrolled one by one.

What can be unrolled (planes, cylinders, prisms) has no cone angles: u is 0, and flat distances are geodesic.
Assumption: boards cover a part that is a disc or a ring once holes of up to 100 mm around are closed.
Failure: ConfigError, also where the scale varies so much that distances are not those of a skin any more.
Source: B. Springborn, P. Schroeder, U. Pinkall, Conformal equivalence of triangle meshes (2008), 3 (Newton's
method for u); M. Ben-Chen, C. Gotsman, G. Bunin, Conformal flattening by curvature prescription (2008).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from skinbus.errors import ConfigError, Fault
from skinbus.robot.mesh import Mesh

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

EDGE: Final = 5e-3
"""m: longer edges are divided; a tactel measures 5 to 10 mm."""
REACH: Final = 0.03
"""m, over which a chart goes on beyond tactels: the laws of covers of up to 10 mm end there."""
HOLE: Final = 0.1
"""m around: less is a hole in a part, more may be the rim of a link of 32 mm and more in diameter."""
SCALES: Final = (0.75, 1.0 / 0.75)
"""Beyond these the scale changes so fast that distances of 10 mm err by a tenth."""
_ROUNDS: Final = 20
_FLAT: Final = 1e-10
"""rad, of the cone angles that are left: turns of the last triangle against the first by less than 1e-6."""


@dataclass(frozen=True, slots=True, eq=False)
class Flattening:
    """A chart: for each corner of each triangle its place in the plane.

    points, triangles   the part of the mesh, (n, 3) m and (m, 3)
    corners             (m, 3, 2) s, a (m); a triangle of a closed chart is where its middle is in a period
    scale               (n,) length in the chart per length on the mesh
    period              m, 0 of a chart that is not closed
    """

    points: Floats
    triangles: Ints
    corners: Floats
    scale: Floats
    period: float


def refine(mesh: Mesh, longest: float = EDGE) -> Mesh:
    """Return a mesh of the same shape whose edges are at most so long (m)."""
    points, triangles = mesh.points, mesh.triangles
    while True:
        every = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, edge_of = np.unique(every, axis=0, return_inverse=True)
        is_long = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1) > longest
        if not is_long.any():
            return Mesh(points, triangles, mesh.messages)
        middle = np.full(len(edges), -1)
        middle[is_long] = len(points) + np.arange(is_long.sum())
        points = np.concatenate([points, points[edges[is_long]].mean(axis=1)])
        triangles = _divided(points, triangles, middle[edge_of.reshape(-1, 3)])


def _divided(points: Floats, triangles: Ints, middle: Ints) -> Ints:
    """Return triangles with the middles (m, 3) of their edges 01, 12, 20 as new corners; -1 of no middle."""
    n_cut = (middle >= 0).sum(axis=1)
    new = [triangles[n_cut == 0]]
    # turned so that the first edge is cut, and where two are, the third is not
    turn = np.where(n_cut == 1, (middle >= 0).argmax(axis=1), ((middle < 0).argmax(axis=1) + 1) % 3)
    turn[(n_cut == 0) | (n_cut == 3)] = 0
    rows, order = np.arange(len(triangles))[:, None], (np.arange(3) + turn[:, None]) % 3
    (a, b, c), (ab, bc, ca) = triangles[rows, order].T, middle[rows, order].T
    one, two, three = (n_cut == n for n in (1, 2, 3))
    for picked, corners in (
        (one, [(a, ab, c), (ab, b, c)]),
        (three, [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]),
    ):
        new += [np.stack([x[picked] for x in corner], -1) for corner in corners]
    # of the quadrangle that is left, along the shorter diagonal
    far = np.linalg.norm(points[a] - points[bc], axis=1) > np.linalg.norm(points[ab] - points[c], axis=1)
    for picked, corners in (
        (two, [(ab, b, bc)]),
        (two & ~far, [(a, ab, bc), (a, bc, c)]),
        (two & far, [(a, ab, c), (ab, bc, c)]),
    ):
        new += [np.stack([x[picked] for x in corner], -1) for corner in corners]
    return np.concatenate(new)


def flatten(mesh: Mesh, skin: Floats, *, name: str = "mesh") -> Flattening:
    """Return the chart of the part of a mesh around tactels at ``skin`` (n, 3) m.

    s grows along the longest axis of the link frame that the part has; a is 0 where z is largest.

    Raises:
        ConfigError: the part is neither a disc nor a ring, or its scale varies too much.
    """
    part = _part(mesh, skin)
    used = np.unique(part)
    points, part = mesh.points[used], np.searchsorted(used, part)
    own = len(part)
    part, rims = _filled(points, part)
    euler = len(np.unique(part)) - len(_edge_list(part)) + len(part)
    if euler != 2 - len(rims) or not 1 <= len(rims) <= 2:
        what = "a closed surface" if not rims else f"{len(rims)} rims, Euler characteristic {euler}"
        raise ConfigError(name, [Fault("skin", what, "boards on a part that is a disc or a ring")])
    u = _scale_factors(points, part, rims, name)
    placed, period = _unroll(points, part, u)
    nearest = cKDTree(points).query(skin)[1]
    u = u - float(u[nearest].mean())
    shrink = float(np.exp(u[rims[0][0]]))  # u was 0 there
    placed, period = placed[:own] * shrink, period * shrink
    part = part[:own]  # without what closes holes
    placed, period = _turned(points, part, placed, period)
    scale = np.exp(u)
    worst = scale[nearest]
    if not (SCALES[0] <= worst.min() and worst.max() <= SCALES[1]):
        seen = f"{worst.min():.2f} to {worst.max():.2f}"
        wanted = (
            f"{SCALES[0]:.2f} to {SCALES[1]:.2f}: fewer boards, the others on another [[link]] of this mesh"
        )
        raise ConfigError(name, [Fault("scale of the chart", seen, wanted)])
    return Flattening(points, part, np.stack([placed.real, placed.imag], -1), scale, period)


def _edge_list(triangles: Ints) -> Ints:
    every = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(every, axis=0)


def _part(mesh: Mesh, skin: Floats) -> Ints:
    """Return the triangles within reach of tactels along the mesh; more, so that they are connected."""
    points, triangles = mesh.points, mesh.triangles
    edges = _edge_list(triangles)
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    graph = csr_array((length, (edges[:, 0], edges[:, 1])), (len(points), len(points)))
    sources = np.unique(cKDTree(points).query(skin)[1])
    away = dijkstra(graph, directed=False, indices=sources, min_only=True)
    reach = REACH
    while True:
        near = np.asarray((away <= reach)[triangles].all(axis=1) | np.isin(triangles, sources).any(axis=1))
        for _ in range(8):  # no corner where two fans of triangles touch: a rim goes through it once
            every = np.sort(triangles[near][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
            sides, counts = np.unique(every, axis=0, return_counts=True)
            double = np.bincount(sides[counts == 1].ravel(), minlength=len(points)) > 2
            more = double[triangles].any(axis=1) & ~near
            if not more.any():
                break
            near |= more
        if _n_pieces(triangles[near]) == 1:
            return triangles[near | _enclosed(points, triangles, near)]
        reach *= 1.5
        if reach > 10.0:
            return triangles[near]


def _n_pieces(triangles: Ints) -> int:
    """Return of how many pieces triangles are that share edges."""
    return int(_pieces(triangles)[0])


def _pieces(triangles: Ints) -> tuple[int, Ints]:
    """Return of how many pieces triangles are that share edges, and the piece of each."""
    first, second = _sides(triangles)[:2]
    graph = coo_array((np.ones(len(first)), (first // 3, second // 3)), (len(triangles), len(triangles)))
    n, piece = connected_components(graph, directed=False)
    return int(n), np.asarray(piece, np.int64)


def _enclosed(points: Floats, triangles: Ints, near: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return the triangles (m,) of the rest that small holes of a part are."""
    rest = np.flatnonzero(~near)
    within = np.zeros(len(triangles), np.bool_)
    if not len(rest):
        return within
    n, piece = _pieces(triangles[rest])
    owner = np.full(len(triangles), -1)
    owner[rest] = piece
    first, second, _ = _sides(triangles)
    start, end = triangles.ravel()[first], triangles[:, [1, 2, 0]].ravel()[first]
    around = np.zeros(n + 1)  # the last one is the part itself
    border = (owner[first // 3] < 0) != (owner[second // 3] < 0)
    length = np.linalg.norm(points[start] - points[end], axis=1)[border]
    np.add.at(around, np.maximum(owner[first // 3], owner[second // 3])[border], length)
    within[rest] = around[piece] < HOLE
    return within


def _sides(triangles: Ints) -> tuple[Ints, Ints, Ints]:
    """Return pairs of sides (3 t + k: corner k to the next) that are one edge, and those without a pair."""
    starts = triangles.ravel()
    ends = triangles[:, [1, 2, 0]].ravel()
    n = int(triangles.max()) + 1
    key, back = starts * n + ends, ends * n + starts
    order = np.argsort(key)
    place = np.minimum(np.searchsorted(key[order], back), len(key) - 1)
    partner = order[place]
    paired = key[partner] == back
    sides = np.arange(len(key))
    once = paired & (sides < partner)
    return sides[once], partner[once], sides[~paired]


def _filled(points: Floats, triangles: Ints) -> tuple[Ints, list[Ints]]:
    """Return the triangles of a part with its holes closed, and its rims: one, or two long ones."""
    rims = _rims(triangles)
    length = [float(np.linalg.norm(points[r] - points[np.roll(r, -1)], axis=1).sum()) for r in rims]
    order = np.argsort(length)[::-1].tolist()
    keep = 2 if len(rims) > 1 and length[order[1]] >= HOLE else 1
    for k in order[keep:]:
        triangles = np.concatenate([triangles, _ears(points, rims[k])])
    return triangles, [rims[k] for k in order[:keep]]


def _ears(points: Floats, rim: Ints) -> Ints:
    """Return triangles (n - 2, 3) that close a hole: ears in the plane that fits best, sharp ones first."""
    loop = rim[::-1].tolist()  # the rim is that of the part; what closes it goes the other way
    off = points[loop] - points[loop].mean(axis=0)
    flat = off @ np.linalg.svd(off, full_matrices=False)[2][:2].T
    x, y = flat.T
    if float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0.0:
        flat[:, 1] *= -1.0
    place = dict(zip(loop, flat[:, 0] + 1j * flat[:, 1], strict=True))
    triangles = []
    while len(loop) > 3:
        here = np.array([place[corner] for corner in loop])
        before, after = np.roll(here, 1), np.roll(here, -1)
        angle = np.angle((before - here) / (after - here)) % (2.0 * np.pi)
        for k in np.argsort(angle).tolist():
            a, b, c = before[k], here[k], after[k]
            sides = [((q - p).conjugate() * (here - p)).imag for p, q in ((a, b), (b, c), (c, a))]
            within = np.minimum(np.minimum(*sides[:2]), sides[2]) > 1e-15
            if not within.any():
                break
        triangles.append((loop[k - 1], loop[k], loop[(k + 1) % len(loop)]))
        del loop[k]
    return np.array([*triangles, loop], np.int64)


def _rims(triangles: Ints) -> list[Ints]:
    """Return the corners of each rim in its order."""
    open_sides = _sides(triangles)[2]
    starts, ends = triangles.ravel()[open_sides], triangles[:, [1, 2, 0]].ravel()[open_sides]
    after = dict(zip(starts.tolist(), ends.tolist(), strict=True))
    rims = []
    while after:
        rim = [next(iter(after))]
        while (there := after.pop(rim[-1], None)) is not None and there != rim[0]:
            rim.append(there)
        rims.append(np.array(rim, np.int64))
    return rims


def _lengths(points: Floats, triangles: Ints, u: Floats) -> Floats:
    """Return the lengths (m, 3) of the sides opposite to the corners under scale factors u."""
    i, j = triangles[:, [1, 2, 0]], triangles[:, [2, 0, 1]]
    return np.asarray(np.exp(0.5 * (u[i] + u[j])) * np.linalg.norm(points[i] - points[j], axis=2))


def _angles(sides: Floats) -> Floats:
    """Return the angles (m, 3) of triangles of these sides, each opposite to its side."""
    a, b, c = sides, sides[:, [1, 2, 0]], sides[:, [2, 0, 1]]
    return np.asarray(np.arccos(np.clip((b * b + c * c - a * a) / (2.0 * b * c), -1.0, 1.0)))


def _scale_factors(points: Floats, triangles: Ints, rims: list[Ints], name: str) -> Floats:
    """Return the scale factors (n,) with which the part is flat."""
    n = len(points)
    is_rim = np.zeros(n, np.bool_)
    for rim in rims:
        is_rim[rim] = True
    inner = np.flatnonzero(~is_rim)
    # one unknown for each inner corner, and one for all of the second rim
    column = np.full(n, -1)
    column[inner] = np.arange(len(inner))
    spread = csr_array((np.ones(len(inner)), (inner, np.arange(len(inner)))), (n, len(inner) + len(rims) - 1))
    gather = spread.T.tocsr()
    if len(rims) == 2:
        ones = csr_array((np.ones(len(rims[1])), (rims[1], np.full(len(rims[1]), len(inner)))), spread.shape)
        first = csr_array((np.ones(len(rims[0])), (np.full(len(rims[0]), len(inner)), rims[0])), gather.shape)
        spread, gather = (spread + ones).tocsr(), (gather + first).tocsr()
    u = np.zeros(n)
    for _ in range(_ROUNDS):
        angles = _angles(_lengths(points, triangles, u))
        left = np.where(is_rim, np.pi, 2.0 * np.pi) - np.bincount(triangles.ravel(), angles.ravel(), n)
        wrong = gather @ left
        if np.abs(wrong).max(initial=0.0) < _FLAT:
            return u
        half: Floats = 0.5 / np.tan(np.clip(angles, 1e-3, np.pi - 1e-3))
        i, j = triangles[:, [1, 2, 0]].ravel(), triangles[:, [2, 0, 1]].ravel()
        # the sums of rows are put in as further entries: those of one place add up
        rows, columns, weights = (
            np.concatenate([i, j, i, j]),
            np.concatenate([j, i, i, j]),
            np.concatenate([-half.ravel(), -half.ravel(), half.ravel(), half.ravel()]),
        )
        laplacian = csr_array((weights, (rows, columns)), (n, n))
        try:
            step: Any = spread @ splu(csc_array(gather @ laplacian @ spread)).solve(-wrong)
        except RuntimeError:  # singular
            break
        u = u + step / max(1.0, 2.0 * float(np.abs(step).max(initial=0.0)))
    wanted = "a mesh without holes and creases there, or fewer boards on it"
    fault = Fault("skin", "a part that cannot be flattened", wanted)
    raise ConfigError(name, [fault])


def _unroll(points: Floats, triangles: Ints, u: Floats) -> tuple[npt.NDArray[np.complex128], float | complex]:
    """Return the corners (m, 3) of the triangles in the plane, and what closes the chart, complex; or 0."""
    sides, angles = (lengths := _lengths(points, triangles, u)), _angles(lengths)
    own = np.zeros((len(triangles), 3), np.complex128)
    own[:, 1] = sides[:, 2]
    own[:, 2] = sides[:, 1] * np.exp(1j * angles[:, 0])
    first, second, _ = _sides(triangles)
    rows, columns = np.concatenate([first, second]), np.concatenate([second, first])
    side_to = coo_array((rows + 1, (rows // 3, columns // 3)), (len(triangles), len(triangles))).tocsr()
    order, before = breadth_first_order(side_to, 0, directed=False)
    partner = dict(zip(rows.tolist(), columns.tolist(), strict=True))
    out_of = np.asarray(side_to[before[order[1:]], order[1:]]).ravel().astype(int) - 1
    turn, shift = np.ones(len(triangles), np.complex128), np.zeros(len(triangles), np.complex128)
    for t, p, side in zip(order[1:].tolist(), before[order[1:]].tolist(), out_of.tolist(), strict=True):
        k, m = side % 3, partner[side] % 3
        start, end = (turn[p] * own[p, q] + shift[p] for q in (k, (k + 1) % 3))
        turn[t] = (start - end) / (own[t, (m + 1) % 3] - own[t, m])
        turn[t] /= abs(turn[t])
        shift[t] = end - turn[t] * own[t, m]
    placed = turn[:, None] * own + shift[:, None]
    apart = placed[first // 3, first % 3] - placed[second // 3, (second % 3 + 1) % 3]
    far = apart[np.abs(apart) > 0.5 * float(sides.mean())]
    if not len(far):
        return placed, 0.0
    least = far[np.abs(far).argmin()]
    return placed, complex(np.mean(far * np.sign((far * least.conjugate()).real)))


def _turned(
    points: Floats, triangles: Ints, placed: npt.NDArray[np.complex128], closes: float | complex
) -> tuple[npt.NDArray[np.complex128], float]:
    """Return corners with s and a as real and imaginary part, and the period."""
    corners = points[triangles]
    u, v = placed[:, 1] - placed[:, 0], placed[:, 2] - placed[:, 0]
    rise_u, rise_v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    # gradient of each coordinate in the plane, times the area, summed
    slope = (1j * (u[:, None] * rise_v - v[:, None] * rise_u)).sum(axis=0)
    axis = int(np.abs(slope).argmax())
    period = abs(closes)
    along = slope[axis] if not period else complex(closes) * -1j
    if (along.conjugate() * slope[axis]).real < 0.0:
        along = -along
    placed = placed * (along.conjugate() / abs(along))
    middle = placed.mean(axis=1)
    if period:
        top = middle[corners[:, :, 2].mean(axis=1).argmax()].imag
        placed = placed - 1j * top
        placed = placed - 1j * period * np.round(placed.imag.mean(axis=1) / period)[:, None]
    else:
        placed = placed - 0.5j * (placed.imag.min() + placed.imag.max())
    return placed - placed.real.min(), period
