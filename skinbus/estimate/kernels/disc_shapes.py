"""How a contact law of fingertips changes with the size of what presses: four modes along its distances.

Under a disc of diameter D instead of a fingertip, an elastic layer carries, per newton,

    k_u(d) = k(d) + u g_1(d) + u^2 g_2(d) + u^3 g_3(d) + u^4 g_4(d),   u = log((1 + (D / D_0)^2) / 2)

with D_0 = 12.25 mm, the middle of fingertips. The modes are least squares over discs of 1 to 26 mm on a layer
of 6 mm; discs of 2 to 25 mm are met to 1 % of their peak. Modes are tables in the law's own half width and
peak, for two sizes of tactels; between them, by the square of the radius, discs are met to 4 % for tactels of
4 to 10 mm. A thinner or thicker layer changes what D a u stands for, and shapes by 2 to 13 % at 25 mm.

A law learned from presses is that of one u, and of one thickness of the layer, by which all lengths scale:
those whose field is nearest to its table. Other sizes change it by the same modes about that u.

Source: ``tests/estimate/kernels/test_disc_shapes.py`` makes the same modes from the layer of the simulator.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

MODES: Final = 4
SPACING: Final = 0.125
"""Half widths (distances at which the law has half its peak), of the tables."""
RADII: Final = (2.5e-3, 4.765e-3)
"""m, of the two sizes of tactels."""
HALVES: Final = (5.8316e-3, 6.1055e-3)
"""m, half widths of the law of fingertips on the layer of 6 mm under them."""
SMALL, USUAL = 0.18378, 0.60909
"""Squares of the tactel's radius in half widths."""
FACTOR: Final = 1e-4
"""Of the peak, the unit of the tables."""

OWN_SIZES: Final = (-0.69, 1.05)
"""u of a law that was learned: discs of 1 to 27 mm, which the modes are made from."""
LAYERS: Final = 0.1
"""Standard deviation of the logarithm of a cover's thickness over the usual one: with a wider prior the noise
of a learned law is taken for another cover, and its sizes are wrong."""
LIKE: Final = 0.01
"""Of the peak, root mean square of what a field and the law that it is differ by: errors of modes and law."""
POINTS_OF_LAW: Final = 8.0
"""Readings that a table is worth: at as many distances fields differ in their own ways."""

# fmt: off
SMALL_FINGERTIP: Final = FACTOR * np.array(
    [9961, 9876, 9619, 9190, 8591, 7836, 6950, 5974, 4961, 3970, 3053, 2254, 1594, 1082, 703, 438, 262, 151,
     86, 50, 32, 25, 22, 22, 22, 21, 20, 17, 15, 11, 7, 4, 0])
USUAL_FINGERTIP: Final = FACTOR * np.array(
    [9961, 9855, 9546, 9051, 8398, 7624, 6767, 5867, 4961, 4084, 3265, 2529, 1892, 1364, 946, 632, 407, 254,
     156, 96, 62, 44, 34, 30, 27, 24, 22, 19, 16, 12, 8, 4, 0])
SMALL_MODES: Final = FACTOR * np.array([
    [-13804, -13458, -12453, -10872, -8847, -6557, -4210, -2021, -175, 1196, 2043, 2396, 2349, 2036, 1597,
     1146, 754, 456, 252, 125, 52, 13, -6, -14, -17, -16, -13, -10, -7, -5, -3, -1, 0],
    [8433, 7890, 6381, 4213, 1801, -425, -2127, -3113, -3361, -2988, -2205, -1250, -337, 382, 837, 1031,
     1015, 866, 657, 447, 271, 142, 58, 9, -15, -24, -25, -21, -16, -11, -7, -3, 0],
    [-1682, -1292, -277, 984, 2029, 2487, 2221, 1350, 186, -910, -1649, -1901, -1697, -1192, -586, -51,
     317, 493, 514, 438, 326, 217, 129, 69, 31, 10, -1, -6, -7, -6, -4, -2, 0],
    [-336, -442, -695, -937, -994, -760, -254, 381, 942, 1253, 1229, 903, 395, -131, -537, -744,
     -751, -610, -397, -185, -18, 85, 132, 139, 123, 98, 72, 50, 32, 19, 10, 4, 0],
])
USUAL_MODES: Final = FACTOR * np.array([
    [-10246, -9985, -9234, -8082, -6653, -5088, -3520, -2060, -793, 225, 964, 1421, 1619, 1603, 1433, 1175,
     888, 620, 398, 233, 122, 54, 16, -3, -11, -13, -12, -10, -7, -5, -3, -1, 0],
    [1923, 1808, 1478, 971, 350, -302, -893, -1333, -1562, -1555, -1334, -958, -509, -69, 294, 537,
     651, 652, 572, 449, 317, 200, 109, 48, 12, -7, -14, -15, -13, -9, -6, -2, 0],
    [2577, 2415, 1985, 1419, 873, 457, 193, 26, -121, -297, -491, -653, -724, -676, -517, -293,
     -61, 127, 243, 283, 264, 212, 152, 98, 57, 30, 13, 4, 0, -2, -2, -1, 0],
    [-1236, -1116, -797, -384, 0, 265, 386, 399, 363, 319, 275, 213, 118, -11, -152, -271,
     -339, -341, -283, -189, -86, 0, 58, 85, 89, 78, 61, 44, 29, 18, 9, 4, 0],
])
# fmt: on


def disc_shapes(step: float, table: Floats, radius: float) -> Floats:
    """Return the modes (4, n) 1/m^2 of a law with this table (n,) 1/m^2 over distances in steps (m).

    ``radius`` (m) is that of the tactels. A law that does not fall to half its peak has no modes.
    """
    below = np.flatnonzero(table < 0.5 * table[0])
    if not (len(below) and table[0] > 0.0):
        return np.zeros((MODES, len(table)))
    i = int(below[0])
    half = step * (i - 1 + float((table[i - 1] - 0.5 * table[0]) / (table[i - 1] - table[i])))
    share = min(max(((radius / half) ** 2 - SMALL) / (USUAL - SMALL), 0.0), 1.0)
    modes = SMALL_MODES + share * (USUAL_MODES - SMALL_MODES)
    return np.asarray(table[0] * _read(modes, step * np.arange(len(table)) / half))


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
        share = min(max(share, 0.0), 1.0)
        at = d / (scale * half)
        modes = _read(SMALL_MODES + share * (USUAL_MODES - SMALL_MODES), at)
        fields = _read(SMALL_FINGERTIP + share * (USUAL_FINGERTIP - SMALL_FINGERTIP), at) + powers @ modes
        peak = fields @ table / (fields**2).sum(axis=1)
        off = np.mean((peak[:, None] * fields - table) ** 2, axis=1) / (LIKE * table[0]) ** 2
        unlike = POINTS_OF_LAW * off + (log_scale / LAYERS) ** 2
        i = int(unlike.argmin())
        if unlike[i] < best:
            best, found, own = float(unlike[i]), peak[i] * modes, float(sizes[i])
    shifted = [
        sum(math.comb(n, m) * own ** (n - m) * found[n - 1] for n in range(m, MODES + 1))
        for m in range(1, MODES + 1)
    ]
    return np.stack(shifted), own


def _read(tables: Floats, at: npt.NDArray[Any]) -> Floats:
    """Return tables (..., m) at distances (n,) in half widths, (..., n)."""
    low = np.minimum((at / SPACING).astype(int), tables.shape[-1] - 2)
    t = np.clip(at / SPACING - low, 0.0, 1.0)
    return np.asarray((1.0 - t) * tables[..., low] + t * tables[..., low + 1])
