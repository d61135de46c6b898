"""Places off the boards are brought to the nearest board."""

from __future__ import annotations

import math

from skinbus.arrays import Floats, Ints
from skinbus.estimate.kernels.geometry import develop, separation, surface_of, undevelop
from skinbus.estimate.kernels.layout import Layout
from skinbus.jit import inner_kernel

INSIDE = 1.0 - 1e-9
"""Share of a board's half extent: a place brought to the edge stays inside after rounding."""


@inner_kernel
def keep_on_board(lay: Layout, link: int, tactels: Ints, n: int, place: Floats) -> int:
    """Bring a place (s, a) to the board of the nearest of n tactels, or its seam; return the board."""
    surface, nearest, patch = surface_of(lay.link, link), math.inf, -1
    for t in range(n):
        i = tactels[t]
        d2, _, _ = separation(surface, place[0], place[1], lay.s[i], lay.a[i])
        if d2 < nearest:
            nearest, patch = d2, lay.patch[i]
    if patch < 0:
        return patch
    cos, sin, half_u, half_v = (
        lay.board[patch, 0],
        lay.board[patch, 1],
        lay.board[patch, 2],
        lay.board[patch, 3],
    )
    x, y = develop(surface, place[0], place[1], lay.patch_a[patch])
    x -= lay.patch_s[patch]
    u, v = cos * x + sin * y, cos * y - sin * x
    if max(abs(u) - half_u, abs(v) - half_v) > 0.0:
        u, v = min(max(u, -INSIDE * half_u), INSIDE * half_u), min(max(v, -INSIDE * half_v), INSIDE * half_v)
        x, y = lay.patch_s[patch] + cos * u - sin * v, sin * u + cos * v
        place[0], place[1] = undevelop(surface, x, y, lay.patch_a[patch])
    return patch
