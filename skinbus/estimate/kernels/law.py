"""The contact laws in kernels: pressure at a distance from a contact, with its derivatives.

::

    p(d) = A g(d) + h(d)          cone:   A = H,  g = 1,     h = -S d,  within d < H / S
                                  radial: A = f,  g = k(d),  h = 0

with the effective force f = F^e of ``model.law``. Amplitudes are a power of the force, A = C F^r: for the
cone H = (3 f / pi)^(1/3) S^(2/3), so C = (3 / pi)^(1/3) S^(2/3) and r = e / 3; for a radial law C = 1, r = e.

A radial law may depend on the size u of the contact: k(d; u) = k(d) + sum_n (u - u_law)^n mode_n(d), with
four modes (``disc_shapes``).

``laws`` has a row for each law, with the columns of ``layout``. ``tables`` (n_laws, points, 24) has six rows
of each law, k, four modes and the misfit profile (1/m^2), with four numbers for each step: value, rise to the
next point, and slopes at both ends. k and modes are cubics of these, the misfit profile is linear.

A new law is a row of ``laws`` and a branch of :func:`pressure`.

Beside the law, tactels may have a width, which stretches distances, and a map of residuals, which adds to k
by place. The chart of a mesh stretches distances, too (``model.bend``).
"""

from __future__ import annotations

import math

from skinbus.arrays import Floats
from skinbus.estimate.kernels.disc_shapes import MODES
from skinbus.estimate.kernels.layout import (
    CONE,
    CORE,
    CORE_PART,
    CORE_PER,
    KIND,
    LAST,
    MISFIT_ROW,
    OWN_SIZE,
    PEAK,
    PER_STEP,
    POWER,
    REACH,
    REACH_PER,
    SCALE,
    SHAPED,
    SLOPE,
    Layout,
)
from skinbus.jit import inner_kernel


@inner_kernel
def amplitude(laws: Floats, law: int, log_force: float) -> tuple[float, float]:
    """Return the amplitude A of a contact of force exp(log_force) N, and dA / d log F."""
    power = float(laws[law, POWER])
    amp = float(laws[law, SCALE]) * math.exp(power * log_force)
    return amp, power * amp


@inner_kernel
def log_force_of(laws: Floats, law: int, amplitude: float) -> float:
    """Return log F (F in N) of a contact of this (positive) amplitude: the inverse of :func:`amplitude`."""
    return math.log(amplitude / laws[law, SCALE]) / float(laws[law, POWER])


@inner_kernel
def log_force_at(laws: Floats, tables: Floats, law: int, p: float, d: float) -> float:
    """Return log F (F in N) of the contact that presses p Pa at distance d: the inverse of :func:`pressure`.

    Where g is below ``CORE_PART`` of its peak, that is used: beyond, the force is not determined.
    """
    unit, _, g, _ = pressure(laws, tables, law, 1.0, d, laws[law, OWN_SIZE])
    return log_force_of(laws, law, max(p + g - unit, 1e-9) / max(g, CORE_PART * laws[law, PEAK]))


@inner_kernel
def reach(laws: Floats, law: int, amplitude: float) -> float:
    """Return the distance beyond which a contact of this amplitude makes no pressure, m."""
    return float(laws[law, REACH] + amplitude * laws[law, REACH_PER])


@inner_kernel
def core(laws: Floats, law: int, amplitude: float) -> float:
    """Return the distance within which a contact is coupled to others, m: see ``CORE_PART``."""
    return float(laws[law, CORE] + amplitude * laws[law, CORE_PER])


@inner_kernel
def pressure(
    laws: Floats, tables: Floats, law: int, amp: float, d: float, u: float
) -> tuple[float, float, float, float]:
    """Return p (Pa) at distance d under a size u, dp/dd, dp/dA, dp/du; for distances within reach."""
    if laws[law, KIND] == CONE:
        return amp - laws[law, SLOPE] * d, -laws[law, SLOPE], 1.0, 0.0
    if not d <= laws[law, REACH]:
        return 0.0, 0.0, 0.0, 0.0
    per_step = laws[law, PER_STEP]
    x = d * per_step
    i = int(min(x, laws[law, LAST]))
    t = x - i
    u -= float(laws[law, OWN_SIZE])
    low = rise = m0 = m1 = by_low = by_rise = 0.0
    for mode in range(MODES if laws[law, SHAPED] != 0.0 else 0, -1, -1):
        column = 4 * mode
        by_low, by_rise = u * by_low + low, u * by_rise + rise
        low, rise = u * low + tables[law, i, column], u * rise + tables[law, i, column + 1]
        m0, m1 = u * m0 + tables[law, i, column + 2], u * m1 + tables[law, i, column + 3]
    bend = m0 + m1 - 2.0 * rise
    quadratic = rise - m0 - bend
    g = low + t * (m0 + t * (quadratic + t * bend))
    slope = (m0 + t * (2.0 * quadratic + 3.0 * t * bend)) * per_step
    return amp * g, amp * slope, g, amp * (by_low + t * by_rise)


@inner_kernel
def misfit_at(laws: Floats, tables: Floats, law: int, d: float) -> float:
    """Return the standard deviation of what a law with a misfit profile leaves at distance d, 1/m^2."""
    x, last = d * laws[law, PER_STEP], laws[law, LAST] + 0.5
    if not x < last:  # beyond its table a law is 0, its misfit is not
        return float(tables[law, int(last), 4 * MISFIT_ROW])
    i = int(x)
    return float(tables[law, i, 4 * MISFIT_ROW] + (x - i) * tables[law, i, 4 * MISFIT_ROW + 1])


@inner_kernel
def residual_at(lay: Layout, i: int, ds: float, da: float) -> tuple[float, float, float]:
    """Return what tactel i reads beside its law (1/m^2) under a contact at (ds, da) from it, and slopes."""
    row, patch = lay.map_of[i], lay.patch[i]
    step, points = lay.map_step[row], lay.map_value.shape[1]
    cos, sin = lay.board[patch, 0], lay.board[patch, 1]
    half = 0.5 * (points - 1)
    u, v = (cos * ds + sin * da) / step + half, (cos * da - sin * ds) / step + half
    # the outermost rows are only neighbours of others
    if not (1.0 <= u < points - 2 and 1.0 <= v < points - 2):
        return 0.0, 0.0, 0.0
    p, q = int(u), int(v)
    r = r_u = r_v = 0.0
    for k in range(p - 1, p + 3):
        by_u, slope_u = catmull_rom(u - k)
        for m in range(q - 1, q + 3):
            by_v, slope_v = catmull_rom(v - m)
            value = lay.map_value[row, k, m]
            r += by_u * by_v * value
            r_u += slope_u * by_v * value
            r_v += by_u * slope_v * value
    return r, (cos * r_u - sin * r_v) / step, (sin * r_u + cos * r_v) / step


@inner_kernel
def catmull_rom(t: float) -> tuple[float, float]:
    """Return the weight of a point t steps before a place, from -2 to 2, and its derivative by t."""
    x, sign = abs(t), math.copysign(1.0, t)
    if x < 1.0:
        return 1.0 + x * x * (1.5 * x - 2.5), sign * x * (4.5 * x - 5.0)
    return 2.0 + x * (x * (2.5 - 0.5 * x) - 4.0), sign * (x * (5.0 - 1.5 * x) - 4.0)
