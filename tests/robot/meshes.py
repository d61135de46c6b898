"""Meshes of surfaces whose geodesics are known: points (n, 3) and triangles (m, 3)."""

import numpy as np


def sphere(radius, subdivisions):
    """An icosahedron that is divided so often."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.array(ball.vertices), np.array(ball.faces, np.int64)


def ellipsoid(axes, edge):
    """An ellipsoid with these half axes and edges of about this length."""
    points, triangles = sphere(1.0, round(np.log2(1.15 * max(axes) / edge)))
    return points * np.asarray(axes), triangles


def wrapped(n, m):
    """The triangles of a grid of n by m places, closed around the second."""
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n - 1), np.arange(m), indexing="ij"))

    def at(i, j):
        return i * m + j % m

    a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    return np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])


def tube(radius, length, edge):
    """An open cylinder along x, as ``Surface.cylinder`` has it: from 0 to its length, angle 0 at +z."""
    n, m = int(np.ceil(length / edge)) + 1, int(np.ceil(2.0 * np.pi * radius / edge))
    x, angle = np.meshgrid(np.linspace(0.0, length, n), np.arange(m) * 2 * np.pi / m, indexing="ij")
    points = np.stack([x, radius * np.sin(angle), radius * np.cos(angle)], -1).reshape(-1, 3)
    return points, wrapped(n, m)
