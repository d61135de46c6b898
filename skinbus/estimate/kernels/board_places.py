"""Places on boards: how far off one is, and the nearest that is on one."""

from __future__ import annotations

from skinbus.estimate.kernels.geometry import develop, surface_of, undevelop
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.jit import inner_kernel

INSIDE = 1.0 - 1e-9
"""Part of a board's half extent that is on it whatever rounding does."""


@inner_kernel
def in_board(lay: Layout, link: int, patch: int, s: float, a: float) -> tuple[float, float]:
    """Return a place of the chart in the frame of a board, (u, v) m."""
    board = lay.board
    x, y = develop(surface_of(lay.link, link), s, a, lay.patch_a[patch])
    x -= lay.patch_s[patch]
    return board[patch, 0] * x + board[patch, 1] * y, board[patch, 0] * y - board[patch, 1] * x


@inner_kernel
def off_board(lay: Layout, link: int, patch: int, place: Floats) -> float:
    """Return how far (m) a place (s, a) is off the board of a patch, the seam around it included; 0 on it."""
    u, v = in_board(lay, link, patch, place[0], place[1])
    return float(max(abs(u) - lay.board[patch, 2], abs(v) - lay.board[patch, 3], 0.0))


@inner_kernel
def onto_board(lay: Layout, link: int, patch: int, place: Floats) -> None:
    """Bring a place (s, a) to the nearest one on the board of a patch, the seam around it included."""
    board = lay.board
    cos, sin = board[patch, 0], board[patch, 1]
    u, v = in_board(lay, link, patch, place[0], place[1])
    half_u, half_v = INSIDE * board[patch, 2], INSIDE * board[patch, 3]
    u, v = min(max(u, -half_u), half_u), min(max(v, -half_v), half_v)
    x, y = lay.patch_s[patch] + cos * u - sin * v, sin * u + cos * v
    place[0], place[1] = undevelop(surface_of(lay.link, link), x, y, lay.patch_a[patch])
