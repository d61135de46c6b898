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


def tube(radius, length, edge):
    """An open cylinder along x, as ``Surface.cylinder`` has it: from 0 to its length, angle 0 at +z."""
    import trimesh

    n, m = int(np.ceil(length / edge)) + 1, int(np.ceil(2.0 * np.pi * radius / edge))
    line = np.column_stack([np.full(n, radius), np.linspace(0.0, length, n)])
    shape = trimesh.creation.revolve(line, sections=m)  # about z; with x and z exchanged it is inside out
    return np.array(shape.vertices)[:, ::-1], np.array(shape.faces)[:, ::-1]
