"""What makes the chart of a mesh that is curved in two directions give geodesic distances around a tactel.

The chart is conformal with the metric ``exp(2 phi) |dz|^2``, where ``exp(-phi)`` is its scale. With the
gradient g and the second derivatives H of phi at a tactel, a place at z from it is at the distance

    d = exp(phi) |z| (1 + b z + z Q z),    b = g / 2,    Q = H / 6 + 5 g g' / 24 - |g|^2 / 24

up to third order in z: the length of the straight line, less what the geodesic saves by its bend. The scale
at the tactel is in its width; a row of a table of bends holds b and Q: b_s, b_a, Q_ss, 2 Q_sa, Q_aa.

Assumption: the scale changes little over the reach of a law. Failure: beyond a factor of two, far beyond any
reach, the correction is cut off.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]

COLUMNS: Final = 5
MOST: Final = 2.0
"""Largest correction, and the inverse of the least: keeps what is far from looking near."""


def bend_of(gradient: Floats, second: Floats) -> Floats:
    """Return the row (5,) of a tactel from the gradient (2,) 1/m and second derivatives (2, 2) of phi."""
    g = np.asarray(gradient, np.float64)
    q = second / 6.0 + 5.0 / 24.0 * np.outer(g, g) - (g @ g) / 24.0 * np.eye(2)
    return np.array([0.5 * g[0], 0.5 * g[1], q[0, 0], 2.0 * q[0, 1], q[1, 1]])


def bent(bends: Floats, ds: npt.ArrayLike, da: npt.ArrayLike) -> Floats:
    """Return distance over that of the scale at the tactel, (...,), of places at (ds, da) m from tactels.

    bends: (..., 5), of the tactels
    """
    x, y = np.asarray(ds, np.float64), np.asarray(da, np.float64)
    b0, b1, b2, b3, b4 = np.moveaxis(bends, -1, 0)
    return np.asarray(np.clip(1.0 + x * (b0 + b2 * x + b3 * y) + y * (b1 + b4 * y), 1.0 / MOST, MOST))


@inner_kernel
def bend_at(bends: Floats, i: int, x: float, y: float) -> tuple[float, float, float]:
    """Return the correction of tactel i for a place at (x, y) from it, and its derivatives by x and y."""
    along, across = bends[i, 0] + bends[i, 2] * x + bends[i, 3] * y, bends[i, 1] + bends[i, 4] * y
    factor = 1.0 + x * along + y * across
    if factor < 1.0 / MOST:
        return 1.0 / MOST, 0.0, 0.0
    if factor > MOST:
        return MOST, 0.0, 0.0
    return factor, along + bends[i, 2] * x, across + bends[i, 4] * y + bends[i, 3] * x
