"""Triangle meshes of links: read from STL, OBJ or PLY, checked, and mended where that is safe.

Mended, with a message: corners that coincide are joined, triangles without area and doubled ones are left
out, holes of up to four edges are closed, windings are made alike, and a closed surface is turned outward.
Refused: what is not one connected surface in which at most two triangles meet at an edge, what cuts through
itself, and what is too large or of a size that no link has. Open rims are reported: geodesics go around them.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from skinbus.errors import ConfigError, Fault, FaultList, SkinbusError

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MOST_TRIANGLES: Final = 300_000
"""A link of a square metre at edges of 3 mm has 260 000; more take minutes and say nothing about a skin."""
MOST_BYTES: Final = 100_000_000
"""Of a file: so many triangles as text, with normals and names."""
SIZES: Final = (0.02, 5.0)
"""m, of the longest side: outside of these the unit is wrong."""
FORMATS: Final = (".stl", ".obj", ".ply")
_PAIRS: Final = 200_000
"""Pairs of triangles that are tested for a cut at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """One connected surface.

    points     (n, 3) m
    triangles  (m, 3) corners, counter-clockwise seen from outside
    messages   what was mended, and rims that are open
    """

    points: Floats
    triangles: Ints
    messages: tuple[str, ...] = ()

    @property
    def normals(self) -> Floats:
        """(m, 3) outward unit normals of the triangles."""
        a, b, c = np.moveaxis(self.points[self.triangles], 1, 0)
        normal = np.cross(b - a, c - a)
        return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])


def load_mesh(path: str | Path, unit: float = 1e-3) -> Mesh:
    """Return the mesh of a file; ``unit`` is the length of its unit, m.

    Raises:
        ConfigError: it cannot be read, or is refused: all faults.
        SkinbusError: trimesh is not installed.
    """
    try:
        import trimesh
    except ImportError as error:
        raise SkinbusError("a mesh needs trimesh: pip install 'skinbus[mesh]'") from error
    kind = Path(path).suffix.lower()
    if kind not in FORMATS:
        raise ConfigError(str(path), [Fault("mesh", kind or None, f"a file {', '.join(FORMATS)}")])
    try:
        found = os.stat(path)
        if not stat.S_ISREG(found.st_mode) or found.st_size > MOST_BYTES:
            wanted = f"a regular file of at most {MOST_BYTES} bytes"
            raise ConfigError(str(path), [Fault("mesh", None, wanted)])
        with open(path, "rb") as file:
            read: Any = trimesh.load(file, file_type=kind[1:], process=False, force="mesh")
        points = unit * np.asarray(read.vertices, np.float64).reshape(-1, 3)
        triangles = np.asarray(read.faces, np.int64).reshape(-1, 3)
    except ConfigError:
        raise
    except OSError as error:
        raise ConfigError(str(path), [Fault("mesh", None, f"a file that can be read ({error})")]) from None
    except Exception as error:  # noqa: BLE001 - a reader of files may raise anything
        wanted = f"a mesh of triangles ({type(error).__name__}: {error})"
        raise ConfigError(str(path), [Fault("mesh", None, wanted)]) from None
    return mend(points, triangles, str(path))


def mend(points: npt.ArrayLike, triangles: npt.ArrayLike, file: str = "mesh") -> Mesh:
    """Return a mesh of points (n, 3) m and triangles (m, 3), mended.

    Raises:
        ConfigError: it is refused: all faults.
    """
    p, t = np.asarray(points, np.float64), np.asarray(triangles, np.int64)
    faults, messages = FaultList(), []
    if not len(t) or p.ndim != 2 or t.min(initial=0) < 0 or t.max(initial=0) >= len(p):
        raise ConfigError(file, [Fault("triangles", len(t), "at least one, of points that there are")])
    if len(t) > MOST_TRIANGLES:
        wanted = f"at most {MOST_TRIANGLES}: simplify it, edges of 3 mm are enough"
        raise ConfigError(file, [Fault("triangles", len(t), wanted)])
    if not np.isfinite(p[t]).all():
        raise ConfigError(file, [Fault("points", "NaN or infinite", "numbers")])
    size = float(np.ptp(p[t.ravel()], axis=0).max())
    if not SIZES[0] <= size <= SIZES[1]:
        faults.append(Fault("size", f"{size:g} m", f"{SIZES[0]:g} to {SIZES[1]:g} m: say its unit"))
    p, t, joined = _join(p, t, 1e-7 * size)
    if joined:
        messages.append(f"{joined} corners that coincide were joined")
    t, dropped = _drop(p, t, 1e-7 * size)
    if dropped:
        messages.append(f"{dropped} triangles without area or doubled were left out")
    if not len(t):
        raise ConfigError(file, [*faults, Fault("triangles", 0, "one with an area")])
    edges, counts = _edges(t)
    for a, b in edges[counts > 2]:
        where = ", ".join(f"{1e3 * x:.1f}" for x in 0.5 * (p[a] + p[b]))
        faults.append(Fault(f"edge at {where} mm", "3 or more triangles", "at most two at an edge"))
    n_parts, _ = parts_of(len(p), t)
    if n_parts > 1:
        faults.append(Fault("parts", n_parts, "one connected surface"))
    if not (counts > 2).any():
        t, turned = _wind(t)
        if turned < 0:
            faults.append(Fault("surface", "one-sided, as a Moebius strip", "an inside and an outside"))
        if turned > 0:
            messages.append(f"{turned} triangles with flipped normals were turned")
        t, closed = _close(t)
        if closed:
            messages.append(f"{closed} holes of up to four edges were closed")
            t, _ = _wind(t)
        rims = _rims(t)
        volume = float(np.einsum("ij,ij->", p[t[:, 0]], np.cross(p[t[:, 1]], p[t[:, 2]]))) / 6.0
        if not rims and volume < 0.0:
            t = t[:, ::-1].copy()
            messages.append("the surface was turned inside out: its normals pointed inward")
        messages += [f"an open rim of {1e3 * _length(p, rim):.0f} mm" for rim in rims[:10]]
    for first, second in list(_cuts(p, t))[:100]:
        where = ", ".join(f"{1e3 * x:.1f}" for x in p[t[first]].mean(axis=0))
        faults.append(Fault(f"triangle {first} at {where} mm", f"cut by triangle {second}", "no cuts"))
    if faults:
        raise ConfigError(file, faults)
    used = np.unique(t)
    return Mesh(p[used], np.searchsorted(used, t), tuple(messages))


def _join(p: Floats, t: Ints, within: float) -> tuple[Floats, Ints, int]:
    """Return points and triangles with corners that coincide joined, and how many were."""
    used = np.unique(t)
    pairs = cKDTree(p[used]).query_pairs(within, output_type="ndarray")
    if not len(pairs):
        return p, t, 0
    n = len(used)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (n, n))
    n_left, group = connected_components(graph, directed=False)
    first = np.full(n_left, n)
    np.minimum.at(first, group, np.arange(n))
    return p[used][first], group[np.searchsorted(used, t)].astype(np.int64), n - n_left


def _drop(p: Floats, t: Ints, least: float) -> tuple[Ints, int]:
    """Return the triangles with an area, each once, and how many were left out."""
    a, b, c = np.moveaxis(p[t], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([np.linalg.norm(x, axis=1) for x in (b - a, c - b, a - c)], axis=0)
    keep = np.flatnonzero(area > least * np.maximum(longest, least))
    _, once = np.unique(np.sort(t[keep], axis=1), axis=0, return_index=True)
    return t[keep[np.sort(once)]], len(t) - len(once)


def _edges(t: Ints) -> tuple[Ints, Ints]:
    """Return the edges (n, 2), the smaller corner first, and how many triangles meet there."""
    every = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
    edges, counts = np.unique(every, axis=0, return_counts=True)
    return edges, counts


def parts_of(n: int, t: Ints) -> tuple[int, Ints]:
    """Return how many parts the triangles are in, by shared corners, and the part of each point."""
    rows = np.concatenate([t[:, 0], t[:, 1]])
    graph = coo_array((np.ones(len(rows)), (rows, np.concatenate([t[:, 1], t[:, 2]]))), (n, n))
    _, label = connected_components(graph, directed=False)
    return len(np.unique(label[t])), np.asarray(label)


def _rims(t: Ints) -> list[list[int]]:
    """Return the open rims as loops of corners."""
    edges, counts = _edges(t)
    after: dict[int, list[int]] = {}
    for a, b in edges[counts == 1].tolist():
        after.setdefault(a, []).append(b)
        after.setdefault(b, []).append(a)
    rims = []
    while after:
        start = next(iter(after))
        rim, here = [start], start
        while after.get(here):
            there = after[here].pop()
            after[there].remove(here)
            if there != start:
                rim.append(there)
            here = there
        after = {corner: others for corner, others in after.items() if others}
        rims.append(rim)
    return rims


def _close(t: Ints) -> tuple[Ints, int]:
    """Return the triangles with holes of up to four edges closed, and how many there were."""
    holes = [rim for rim in _rims(t) if len(rim) in (3, 4)]
    if 2 * len(holes) > len(t):  # a single triangle has a rim of three edges
        return t, 0
    more = [rim[:3] for rim in holes] + [[rim[0], rim[2], rim[3]] for rim in holes if len(rim) == 4]
    known = {tuple(sorted(triangle)) for triangle in t.tolist()}
    more = [triangle for triangle in more if tuple(sorted(triangle)) not in known]
    return (np.concatenate([t, np.array(more, np.int64)]), len(holes)) if more else (t, 0)


def _wind(t: Ints) -> tuple[Ints, int]:
    """Return triangles wound alike, and how many were turned: the fewer ones; -1 where that cannot be."""
    directed = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    owner = np.tile(np.arange(len(t)), 3)
    forward = directed[:, 0] < directed[:, 1]
    _, edge = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
    order = np.argsort(edge.ravel(), kind="stable")
    same = edge.ravel()[order][1:] == edge.ravel()[order][:-1]
    first, second = order[:-1][same], order[1:][same]
    # two-colouring: twice the triangles, as they are and turned; neighbours that agree are of one colour
    n = len(t)
    a, b, differ = owner[first], owner[second], forward[first] == forward[second]
    rows = np.concatenate([a, a + n])
    columns = np.concatenate([np.where(differ, b + n, b), np.where(differ, b, b + n)])
    _, label = connected_components(coo_array((np.ones(len(rows)), (rows, columns)), (2 * n, 2 * n)), False)
    if (label[:n] == label[n:]).any():
        return t, -1
    turned = label[:n] != label[0]
    if 2 * turned.sum() > n:
        turned = ~turned
    wound = t.copy()
    wound[turned] = wound[turned][:, ::-1]
    return wound, int(turned.sum())


def _length(p: Floats, rim: list[int]) -> float:
    loop = p[[*rim, rim[0]]]
    return float(np.linalg.norm(np.diff(loop, axis=0), axis=1).sum())


def _cuts(p: Floats, t: Ints) -> Iterator[tuple[int, int]]:
    """Yield pairs of triangles without a common corner of which an edge of one goes through the other."""
    corners = p[t]
    centre = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    # those of like size together: one large triangle must not make all small ones search far
    group = np.round(np.log2(reach)).astype(int)
    for size in np.unique(group):
        own = np.flatnonzero(group == size)
        for part in np.array_split(own, max(1, len(own) // 5_000)):
            smaller = np.flatnonzero(group <= size)
            near = cKDTree(centre[smaller]).query_ball_point(centre[part], 2.0 * reach[part].max())
            first = np.repeat(part, [len(x) for x in near])
            second = smaller[np.concatenate([np.asarray(x, np.int64) for x in near])]
            keep = (group[second] < group[first]) | (first < second)
            keep &= np.linalg.norm(centre[first] - centre[second], axis=1) < reach[first] + reach[second]
            first, second = first[keep], second[keep]
            keep = (t[first][:, :, None] != t[second][:, None, :]).all(axis=(1, 2))
            first, second = first[keep], second[keep]
            for k in range(0, len(first), _PAIRS):
                i, j = first[k : k + _PAIRS], second[k : k + _PAIRS]
                crosses = _crosses(corners[i], corners[j]) & _crosses(corners[j], corners[i])
                i, j = i[crosses], j[crosses]
                cut = _pierces(corners[i], corners[j]) | _pierces(corners[j], corners[i])
                yield from zip(i[cut].tolist(), j[cut].tolist(), strict=True)


def _crosses(corners: Floats, plane_of: Floats) -> npt.NDArray[np.bool_]:
    """Return whether triangles (n, 3, 3) have corners on both sides of the planes of others (n, 3, 3)."""
    a, b, c = np.moveaxis(plane_of, 1, 0)
    normal = np.cross(b - a, c - a)
    side = np.einsum("nkx,nx->nk", corners - a[:, None], normal)
    some = 1e-9 * np.linalg.norm(normal, axis=1)
    return np.asarray((side.min(axis=1) < -some) & (side.max(axis=1) > some))


def _pierces(edges_of: Floats, through: Floats) -> npt.NDArray[np.bool_]:
    """Return whether an edge of each triangle (n, 3, 3) goes through another one (n, 3, 3).

    Source: T. Moeller, B. Trumbore, Fast, minimum storage ray/triangle intersection (1997).
    """
    a, b, c = np.moveaxis(through, 1, 0)
    u, v = b - a, c - a
    found = np.zeros(len(a), np.bool_)
    for k in range(3):
        origin, direction = edges_of[:, k], edges_of[:, (k + 1) % 3] - edges_of[:, k]
        h = np.cross(direction, v)
        det = np.einsum("ij,ij->i", u, h)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = origin - a
            x = np.einsum("ij,ij->i", s, h) / det
            q = np.cross(s, u)
            y = np.einsum("ij,ij->i", direction, q) / det
            along = np.einsum("ij,ij->i", v, q) / det
            found |= (x > 0) & (y > 0) & (x + y < 1) & (along > 0) & (along < 1) & np.isfinite(det)
    return found
