"""Tactels given as points in space, laid flat: their places on the board."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skinbus.arrays import Floats

FACING = 0.9
"""Share of x in a normal beyond which y is the direction of u."""


class Outline(NamedTuple):
    """A board laid flat, and where its centre was."""

    uv: Floats
    """(n, 2) m, from the middle of their extent."""
    centre: Floats
    """(3,) m."""
    along: Floats
    """(3,) direction of u there."""


def lay_flat(points: Floats, normals: Floats) -> Outline:
    """Return the places of tactels on their board, u along x as far as the board allows (y if it faces x).

    Lengths are those along the surface: exact on planes, cylinders and spheres, where the surface bends
    evenly from the middle tactel to each other one.

    Args:
        points:  (n, 3) m.
        normals: (n, 3) outward, of any length.

    Raises:
        ValueError: a normal has no length, or is a right angle or more from that of the middle tactel.
    """
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    middle = np.linalg.norm(points - points.mean(0), axis=1).argmin()
    with np.errstate(invalid="ignore"):
        normals = normals / lengths
    up = normals[middle]
    if (wrong := ~(normals @ up > 0.0)).any():
        raise ValueError(
            f"normal {1 + wrong.argmax()} is zero, or turned by a right angle from the middle one"
        )
    d, axis = points - points[middle], np.cross(up, normals)
    sin = np.linalg.norm(axis, axis=1, keepdims=True)
    axis /= np.maximum(sin, 1e-12)
    # in the plane of the bend a chord stands for an arc; along its axis nothing bends
    towards, straight = np.cross(axis, up), (d * axis).sum(1, keepdims=True) * axis
    half = 0.5 * np.arcsin(np.minimum(sin, 1.0))
    arc = np.linalg.norm(d - straight, axis=1, keepdims=True) / np.sinc(half / np.pi)
    bent = straight + np.copysign(arc, (d * towards).sum(1, keepdims=True)) * towards
    tangent = np.where(sin > 1e-9, bent, d - (d @ up)[:, None] * up)
    u = np.eye(3)[int(abs(up[0]) > FACING)]
    u = u - up * (u @ up)
    axes = np.array([u / np.linalg.norm(u), np.cross(up, u / np.linalg.norm(u))])
    uv = tangent @ axes.T
    shift = 0.5 * (uv.max(0) + uv.min(0))
    return Outline(uv - shift, points[middle] + shift @ axes, axes[0])
