"""What of an arm does not move against its links: surfaces, boards and tactels as plain arrays of meshes.

All arrays are float32 in the frame of a link, m; faces are counter-clockwise seen from outside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm, PlacedPatch, Surface
from skinbus.model.mesh_surface import MeshSurface

Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.uint32]

SAGITTA: Final = 0.2e-3
"""Most by which a facet may lie inside of the surface, m: below what is seen of an arm on a screen."""
UNDER: Final = 1.5e-3
"""Depth of the drawn link under its surface, m: more than facets are off, so that boards stay in front."""
BOARD_EDGE: Final = 5
"""Points along an edge of a board, 12.5 mm apart: on a radius of 40 mm a facet is 0.5 mm off, below OVER."""
OVER: Final = 0.8e-3
"""Height of a tactel over its board, m: a flat disc of 9.5 mm on a radius of 40 mm bends away by 0.3 mm."""


_CORNERS: Final = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
"""Of a square, counter-clockwise."""


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """Triangles."""

    vertices: Floats
    """(n_vertices, 3) m."""
    faces: Ints
    """(n_faces, 3)"""


@dataclass(frozen=True, slots=True, eq=False)
class Discs:
    """Instances of the unit disc."""

    centre: Floats
    """(n, 3) m."""
    wxyz: Floats
    """(n, 4) unit quaternions that turn z to the normal."""
    radius: Floats
    """(n,) m."""


def link_mesh(surface: Surface) -> Triangles:
    """Return the body of a link, a little under its surface; closed surfaces get caps."""
    if isinstance(surface, MeshSurface):
        a, b, c = (surface.points[surface.triangles[:, k]] for k in range(3))
        normals = np.zeros_like(surface.points)
        for corner in surface.triangles.T:
            np.add.at(normals, corner, np.cross(b - a, c - a))
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-30)[:, None]
        return _mesh(surface.points - UNDER * normals, surface.triangles)
    if surface.kind == "plane":
        half = 0.5 * surface.width
        corners = [(0.0, -half), (surface.length, -half), (surface.length, half), (0.0, half)]
        top = [(s, a, -UNDER) for s, a in corners]
        bottom = [(s, a, -4.0 * UNDER) for s, a in corners]
        sides = [
            face
            for k in range(4)
            for face in ((k, k + 4, (k + 1) % 4), ((k + 1) % 4, k + 4, (k + 1) % 4 + 4))
        ]
        return _mesh([*top, *bottom], [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6), *sides])
    widest = surface.radius + 0.5 * abs(surface.taper) * surface.length
    n = max(16, math.ceil(math.pi / math.acos(1.0 - SAGITTA / widest)))
    angle = np.arange(n) * (math.tau / n)
    rings = []
    for s in (0.0, surface.length):
        points, normals = surface.position(np.full(n, s), angle * surface.radius)
        rings.append(points - UNDER * normals)
    k, after = np.arange(n), (np.arange(n) + 1) % n
    wall = np.concatenate([np.stack([k, k + n, after], -1), np.stack([after, k + n, after + n], -1)])
    centres = [ring.mean(0) for ring in rings]
    caps = np.concatenate(
        [
            np.stack([np.full(n, 2 * n), k, after], -1),
            np.stack([np.full(n, 2 * n + 1), after + n, k + n], -1),
        ]
    )
    return _mesh(np.concatenate([*rings, centres]), np.concatenate([wall, caps]))


def board_meshes(arm: Arm, link: int) -> Triangles:
    """Return the boards of a link, bent to its surface, as one mesh."""
    meshes = [_board(arm.links[link].surface, placed) for placed in arm.patches if placed.link == link]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Triangles(
        np.concatenate([mesh.vertices for mesh in meshes] or [np.zeros((0, 3), np.float32)]),
        np.concatenate(
            [mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]
            or [np.zeros((0, 3), np.uint32)]
        ),
    )


def board_outline(arm: Arm, patch: int, lift: float = 0.5 * OVER) -> Floats:
    """Return the edge of a board, (n_segments, 2, 3) m."""
    placed = arm.patches[patch]
    t = np.linspace(-1.0, 1.0, BOARD_EDGE)
    one = np.ones_like(t)
    edge = np.concatenate([np.stack(side, -1) for side in ((t, -one), (one, t), (-t, one), (-one, -t))])
    loop = _on_board(arm.links[placed.link].surface, placed, edge, lift)
    return np.stack([loop, np.roll(loop, -1, 0)], 1)


def board_cross(arm: Arm, patch: int) -> Floats:
    """Return the two diagonals of a board, (n_segments, 2, 3) m: what crosses out a lost one."""
    placed = arm.patches[patch]
    t = np.linspace(-1.0, 1.0, BOARD_EDGE)
    lines = [
        _on_board(arm.links[placed.link].surface, placed, np.stack([t, sign * t], -1), 2.5 * OVER)
        for sign in (1.0, -1.0)
    ]
    return np.concatenate([np.stack([line[:-1], line[1:]], 1) for line in lines])


def tactel_discs(arm: Arm, link: int, scale: float = 1.0, lift: float = OVER) -> Discs:
    """Return the tactels of a link, in the order of their numbers."""
    here = arm.tactel_link == link
    diameters = np.array([placed.patch.diameter for placed in arm.patches])[arm.tactel_patch[here]]
    points, normals = arm.links[link].surface.position(arm.tactel_s[here], arm.tactel_a[here])
    centre = points + lift * normals
    return Discs(
        centre.astype(np.float32), quaternions(normals), (0.5 * scale * diameters).astype(np.float32)
    )


def tactel_squares(arm: Arm, link: int, lift: float = OVER) -> Floats:
    """Return the corners of squares on the tactels of a link, along its boards, each as large as its tactel.

    (n_tactels of the link, 4, 3) m, counter-clockwise; in the order of the tactels' numbers
    """
    surface = arm.links[link].surface
    squares = [np.zeros((0, 4, 3))]
    for p, placed in enumerate(arm.patches):
        if placed.link != link:
            continue
        corners = 0.25 * math.sqrt(math.pi) * placed.patch.diameter * _CORNERS
        if placed.on_chart is None:
            s, a = placed.on_link(surface, (placed.patch.tactels_uv[:, None] + corners).reshape(-1, 2))
        else:
            here = arm.tactels_of(p)
            turn = np.array([[math.cos(placed.yaw), math.sin(placed.yaw)]])
            s = (arm.tactel_s[here, None] + corners @ (turn * (1.0, -1.0))[0]).ravel()
            a = (arm.tactel_a[here, None] + corners @ turn[0, ::-1]).ravel()
        points, normals = surface.position(s, a)
        squares.append((points + lift * normals).reshape(-1, 4, 3))
    return np.concatenate(squares).astype(np.float32)


def unit_disc(n: int) -> Triangles:
    """Return a disc of n corners about z, facing +z, with the area of one of radius 1."""
    radius = math.sqrt(math.tau / (n * math.sin(math.tau / n)))
    angle = (np.arange(n) + 0.5) * (math.tau / n)
    k = np.arange(1, n - 1)
    rim = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], -1)
    return _mesh(rim, np.stack([np.zeros_like(k), k, k + 1], -1))


def quaternions(normals: npt.NDArray[np.float64]) -> Floats:
    """Return unit quaternions (n, 4) that turn z to unit vectors (n, 3) by the shortest way."""
    x, y, z = normals.T
    q = np.stack([1.0 + z, -y, x, np.zeros_like(z)], -1)
    q[z < -1.0 + 1e-9] = (0.0, 1.0, 0.0, 0.0)
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True), np.float32)


def _board(surface: Surface, placed: PlacedPatch) -> Triangles:
    t = np.linspace(-1.0, 1.0, BOARD_EDGE)
    v, u = np.meshgrid(t, t, indexing="ij")
    vertices = _on_board(surface, placed, np.stack([u.ravel(), v.ravel()], -1), 0.0)
    k = (np.arange(BOARD_EDGE - 1)[:, None] * BOARD_EDGE + np.arange(BOARD_EDGE - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([k, k + 1, k + BOARD_EDGE], -1),
            np.stack([k + 1, k + BOARD_EDGE + 1, k + BOARD_EDGE], -1),
        ]
    )
    return Triangles(vertices, faces.astype(np.uint32))


def _on_board(surface: Surface, placed: PlacedPatch, shares: npt.NDArray[np.float64], lift: float) -> Floats:
    """Return points (n, 3) at shares (n, 2) of half the extents of a board, lifted off the surface."""
    points, normals = surface.position(*placed.on_link(surface, 0.5 * np.array(placed.patch.size) * shares))
    return np.asarray(points + lift * normals, np.float32)


def _mesh(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> Triangles:
    return Triangles(np.asarray(vertices, np.float32), np.asarray(faces, np.uint32))
