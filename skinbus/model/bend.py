"""What makes the chart of a mesh that is curved in two directions give geodesic distances around a tactel.

A place at (x, y) from a tactel on the chart is at the distance

    d = |(x, y)| / scale (1 + b1 x + b2 y + b3 x^2 + b4 xy + b5 y^2 + b6 x^3 + b7 x^2 y + b8 xy^2 + b9 y^3)

with the scale of the chart at the tactel, which is in its width. A row of a table of bends holds b1 to b9, as
``robot.mesh_link`` finds them by least squares: on an ellipsoid of half axes 90, 70 and 60 mm they err by
0.8 % at 40 mm, where Taylor's series of second degree errs by 3.8 %.

Assumption: the scale changes little over the reach of a law. Failure: beyond a factor of two, far beyond any
reach, the correction is cut off.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats

EXPONENTS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
"""Of x and y, by column of a row."""
COLUMNS = len(EXPONENTS)
POWERS = np.array([float(i + j) for i, j in EXPONENTS])
"""Of the inverse of the length unit, by column."""
MOST = 2.0
"""Largest correction, and the inverse of the least: keeps what is far from looking near."""


def bent(bends: Floats, ds: npt.ArrayLike, da: npt.ArrayLike) -> Floats:
    """Return distance over that of the scale at the tactel, (...,), of places at (ds, da) m from tactels.

    bends: (..., 9), of the tactels
    """
    x, y = np.asarray(ds, np.float64), np.asarray(da, np.float64)
    b1, b2, b3, b4, b5, b6, b7, b8, b9 = np.moveaxis(bends, -1, 0)
    along, across = b1 + x * (b3 + b6 * x + b7 * y) + b4 * y, b2 + y * (b5 + b8 * x + b9 * y)
    return np.asarray(np.clip(1.0 + x * along + y * across, 1.0 / MOST, MOST))
