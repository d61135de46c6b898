"""The correction of ``model.bend`` as a kernel: a file of its own, for those who do without numba."""

from __future__ import annotations

from skinbus.arrays import Floats
from skinbus.jit import inner_kernel
from skinbus.model.bend import MOST


@inner_kernel
def bend_at(bends: Floats, i: int, x: float, y: float) -> tuple[float, float, float]:
    """Return the correction of tactel i for a place at (x, y) from it, and its derivatives by x and y."""
    u = x * (bends[i, 2] + bends[i, 5] * x + bends[i, 6] * y)
    v = y * (bends[i, 4] + bends[i, 7] * x + bends[i, 8] * y)
    along, across = bends[i, 0] + u + bends[i, 3] * y, bends[i, 1] + v
    factor = 1.0 + x * along + y * across
    if factor < 1.0 / MOST:
        return 1.0 / MOST, 0.0, 0.0
    if factor > MOST:
        return MOST, 0.0, 0.0
    by_x = along + u + bends[i, 5] * x * x + bends[i, 7] * y * y
    return factor, by_x, across + v + bends[i, 8] * y * y + x * (bends[i, 3] + bends[i, 6] * x)
