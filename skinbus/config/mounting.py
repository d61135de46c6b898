"""Do boards fit where they are placed: overhang over a link's ends, overlap of two of them.

Boards are bent without stretching, so on the developed surface they keep their shapes. Overlap is decided
there by separating axes: a convex pair is apart if a line separates it. A board is the hull of its tactels
with their margin to its sides: a rectangle if they are a grid; triangles may stand between triangles.
"""

from __future__ import annotations

import math

import numpy as np

from skinbus.arrays import Floats
from skinbus.model.arm import PlacedPatch
from skinbus.model.surface import Surface

_ALONG = np.linspace(0.0, 4.0, 129)
"""Places on the sides, from corner to corner: half a step of 50 mm / 32 is 6 um off a radius of 50 mm."""
_STEPS = np.arange(0.0, math.pi / 2.0, math.pi / 128.0)
"""Directions of lines that may separate, from a side of a board: others are met to 1.2 % of a length."""
_SIGNS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], np.float64)


def _outline(placed: PlacedPatch) -> Floats:
    """Return points on the surface developed about the centre of a board whose hull it is, (n, 2) m.

    The first two are along one side.
    """
    uv, half = np.asarray(placed.patch.tactels_uv), 0.5 * np.array(placed.patch.size)
    margin = np.maximum(half - np.abs(uv).max(0), 1e-6)
    return placed.developed(placed.scale * (uv[:, None] + _SIGNS * margin).reshape(-1, 2))


def outside(surface: Surface, placed: PlacedPatch) -> float:
    """Return how far a board reaches beyond its link, m; 0 or less when it fits."""
    # points along all four sides, which miss no more than 0.01 mm of a curve
    corners = placed.developed(0.5 * placed.scale * _SIGNS[[0, 1, 2, 3, 0]] * np.array(placed.patch.size))
    x, y = (np.interp(_ALONG, range(5), side) for side in corners.T)
    s, _ = surface.undevelop(x, y, placed.a)  # on a cone a straight side is not one of constant s
    over = max(float(-s.min()), float(s.max()) - surface.length)
    if surface.period == 0.0:
        return max(over, float(np.abs(placed.a + y).max()) - 0.5 * surface.width)
    around = float(surface.period * surface.radius_at(placed.s) / surface.radius)
    return max(over, float(np.ptp(y)) - around)


def overlap(surface: Surface, first: PlacedPatch, second: PlacedPatch) -> float:
    """Return how deep two boards on one link overlap, m; negative is the width of the gap at least."""
    one = _outline(first)
    x, y = _outline(second).T
    s, a = surface.undevelop(x, y, second.a)
    x, y = surface.develop(s, a, first.a)
    if surface.period and float(np.ptp(y)) > 0.5 * surface.period:
        return -math.inf  # the second board lies on the far side, where the development is cut
    two = np.stack([x, y], -1)
    sides = one[1] - one[0], two[1] - two[0]
    angles = np.concatenate([np.arctan2(side[1], side[0]) + _STEPS for side in sides])
    normals = np.concatenate([[np.cos(angles), np.sin(angles)], [-np.sin(angles), np.cos(angles)]], axis=1)
    a, b = one @ normals, two @ normals
    return float((np.minimum(a.max(0), b.max(0)) - np.maximum(a.min(0), b.min(0))).min())
