"""Places on boards: how far off one is, and the nearest that is on one."""

from __future__ import annotations

from skinbus.estimate.kernels.geometry import develop, surface_of, undevelop
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.jit import inner_kernel

INSIDE = 1.0 - 1e-9
"""Part of a board's half extent that is on it whatever rounding does."""


@inner_kernel
def off_board(lay: Layout, link: int, patch: int, place: Floats) -> float:
    """Return how far (m) a place (s, a) is off the board of a patch, the seam around it included; 0 on it."""
    board, surface = lay.board, surface_of(lay.link, link)
    x, y = develop(surface, place[0], place[1], lay.patch_a[patch])
    x -= lay.patch_s[patch]
    u = board[patch, 0] * x + board[patch, 1] * y
    v = board[patch, 0] * y - board[patch, 1] * x
    return float(max(abs(u) - board[patch, 2], abs(v) - board[patch, 3], 0.0))


@inner_kernel
def onto_board(lay: Layout, link: int, patch: int, place: Floats) -> None:
    """Bring a place (s, a) to the nearest one on the board of a patch, the seam around it included."""
    board, patch_s, patch_a = lay.board, lay.patch_s, lay.patch_a
    surface = surface_of(lay.link, link)
    cos, sin = board[patch, 0], board[patch, 1]
    x, y = develop(surface, place[0], place[1], patch_a[patch])
    x -= patch_s[patch]
    u, v = cos * x + sin * y, cos * y - sin * x
    half_u, half_v = INSIDE * board[patch, 2], INSIDE * board[patch, 3]
    u, v = min(max(u, -half_u), half_u), min(max(v, -half_v), half_v)
    x, y = patch_s[patch] + cos * u - sin * v, sin * u + cos * v
    place[0], place[1] = undevelop(surface, x, y, patch_a[patch])
