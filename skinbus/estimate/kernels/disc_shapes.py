"""How a contact law of fingertips changes with the size of what presses: four modes along its distances.

Under a disc of diameter D instead of a fingertip, an elastic layer carries, per newton,

    k_u(d) = k(d) + u g_1(d) + u^2 g_2(d) + u^3 g_3(d) + u^4 g_4(d),   u = log((1 + (D / D_0)^2) / 2)

with D_0 = 12.25 mm, the middle of fingertips. The modes were fitted by least squares to discs of 1 to 26 mm
on a layer of 6 mm, and meet discs of 2 to 25 mm within 1 % of their peak. They are tables over distance in
half widths of the law, in units of its peak, for two radii of tactels. Between these they are interpolated by
the square of the radius: errors are up to 4 % for tactels of 4 to 10 mm. On a thinner or thicker layer a u
stands for another D, and shapes differ by 2 to 13 % at 25 mm.

A law learned from presses has a u of its own and a thickness of the layer, by which all lengths scale: those
whose field is nearest to its table. Other sizes change it by the same modes about this u.

The tables are in ``disc_shapes.csv``, made from the layer of the simulator.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from skinbus.arrays import Floats

MODES = 4
"""Powers of u."""
SPACING = 0.25
"""Step of the tables, in half widths: distances at which the law has half its peak."""
RADII = (2.5e-3, 4.765e-3)
"""m, of the two sizes of tactels."""
HALVES = (5.8316e-3, 6.1055e-3)
"""m, half widths of the law of fingertips on the layer of 6 mm under them."""
SMALL, USUAL = ((radius / half) ** 2 for radius, half in zip(RADII, HALVES, strict=True))
"""Squares of the tactel's radius in half widths."""
OWN_SIZES = (-0.69, 1.05)
"""Bounds of u, discs of 1 to 27 mm: the modes hold within."""
LAYERS = 0.1
"""Prior standard deviation of the log of a cover's thickness over the usual one. With a wider one, noise of a
learned law is taken for another thickness, and sizes are wrong."""
LIKE = 0.0035
"""Standard deviation of the mean difference between a learned table and the field of its true size, as a
share of the peak: 0.01 (root mean square) over the root of eight independent distances."""

AS_MADE, FINGER, TIP, THUMB, KINDS = range(5)
"""Kinds of size, the simplest first, and their number."""
MEANS = (0.0, 0.0, -0.5, 0.62)
SPREADS = (0.02, 0.17, 0.13, 0.3)
"""Prior mean and standard deviation of u by kind: as calibrated (the mean is that of the law), discs of
10-15, 2-8 and 16-25 mm."""
LEARNED_SHARES, SHIPPED_SHARES = (0.5, 0.1, 0.2, 0.2), (0.0, 0.6, 0.2, 0.2)
"""Prior shares: what calibrated a skin is what presses it most often; else fingertips are."""

FIELDS = 1e-4 * np.loadtxt(Path(__file__).with_suffix(".csv"), delimiter=",").reshape(2, MODES + 1, -1)
"""Field of a fingertip and modes, for both sizes of tactels."""


def disc_shapes(step: float, table: Floats, radius: float) -> Floats:
    """Return the modes (4, n) 1/m^2 of a law with this table (n,) 1/m^2 over distances in steps (m).

    ``radius`` (m) is that of the tactels. A law that does not fall to half its peak has no modes.
    """
    below = np.flatnonzero(table < 0.5 * table[0])
    if not (len(below) and table[0] > 0.0):
        return np.zeros((MODES, len(table)))
    i = int(below[0])
    half = step * (i - 1 + float((table[i - 1] - 0.5 * table[0]) / (table[i - 1] - table[i])))
    share = ((radius / half) ** 2 - SMALL) / (USUAL - SMALL)
    return np.asarray(table[0] * _read(share, step * np.arange(len(table)) / half)[1:])


def learned_shapes(step: float, table: Floats, radius: float) -> tuple[Floats, float]:
    """Return the modes (4, n) 1/m^2 of a law that was learned, about its own u, and that u.

    Arguments are those of :func:`disc_shapes`.
    """
    sizes = np.linspace(OWN_SIZES[0], OWN_SIZES[1], 60)
    powers = sizes[:, None] ** np.arange(1, MODES + 1)
    d = step * np.arange(len(table))
    best, found, own = math.inf, np.zeros((MODES, len(table))), 0.0
    for log_scale in np.linspace(-3.0, 3.0, 25) * LAYERS:
        scale = math.exp(log_scale)
        share = ((radius / scale) ** 2 - RADII[0] ** 2) / (RADII[1] ** 2 - RADII[0] ** 2)
        half = math.sqrt(
            max(HALVES[0] ** 2 + share * (HALVES[1] ** 2 - HALVES[0] ** 2), (0.5 * HALVES[0]) ** 2)
        )
        fingertip, *modes = _read(share, d / (scale * half))
        fields = fingertip + powers @ modes
        peak = fields @ table / (fields**2).sum(axis=1)
        off = np.mean((peak[:, None] * fields - table) ** 2, axis=1) / (LIKE * table[0]) ** 2
        unlike = off + (log_scale / LAYERS) ** 2
        i = int(unlike.argmin())
        if unlike[i] < best:
            best, found, own = float(unlike[i]), peak[i] * np.array(modes), float(sizes[i])
    shifted = [
        sum(math.comb(n, m) * own ** (n - m) * found[n - 1] for n in range(m, MODES + 1))
        for m in range(1, MODES + 1)
    ]
    return np.stack(shifted), own


def _read(share: float, at: npt.NDArray[Any]) -> Floats:
    """Return field and modes (5, n) at distances (n,) in half widths, by splines that are flat at 0.

    ``share`` is the way from the small tactels to the usual ones.
    """
    tables = FIELDS[0] + min(max(share, 0.0), 1.0) * (FIELDS[1] - FIELDS[0])
    last = SPACING * (tables.shape[-1] - 1)
    spline = CubicSpline(np.linspace(0.0, last, tables.shape[-1]), tables, axis=-1, bc_type="clamped")
    return spline(np.minimum(at, last))
