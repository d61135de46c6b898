"""The contact laws in kernels, behind one small interface: both are affine in an amplitude.

::

    p(d) = A g(d) + h(d)          cone:   A = H,  g = 1,     h = -S d,  where p > 0, else p = 0
                                  radial: A = f,  g = k(d),  h = 0

with the effective force f = F^e of ``model.law``. Both amplitudes are a power of the force, for the cone

    H = (3 f / pi)^(1/3) S^(2/3) = C F^r,  C = (3 / pi)^(1/3) S^(2/3),  r = e / 3

and f itself with C = 1, r = e, so that a fit needs only p, dp/dd, dp/dA and A(F). ``laws`` has a row per law:
kind, slope (Pa/m), C, r, step (m), points, misfit, whether it has a misfit profile, typical force (N, 0 for
none), core (m), whether it was measured without what presses, 1 / step, whether it has modes by size, the
size that it is of, end of the table (m, negative for none), middle of its last step; ``tables`` (n_laws,
points, 22) has for the step from a point to the next the coefficients of k in 1/m^2, a cubic, the misfit
profile with its rise, and of four modes by size (``disc_shapes``) value, rise and the slopes at both ends.

A board with a response has beside its law a width of each tactel, that stretches distances, and a map of
residuals, that adds to k by place; one without has width 1 and no map.
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.disc_shapes import MODES
from skinbus.estimate.kernels.geometry import is_flat
from skinbus.estimate.kernels.layout import CONE, Floats, Layout
from skinbus.jit import inner_kernel

KIND, SLOPE, SCALE, POWER, STEP, POINTS, MISFIT, PROFILED, TYPICAL, CORE, UNSIZED, PER_STEP = range(12)
SHAPED, OWN_SIZE, END, LAST = 12, 13, 14, 15
"""Columns of ``laws``."""
LEFT, FIRST_MODE = 4, 6
"""Columns of ``tables``."""


@inner_kernel
def is_plain(lay: Layout, link: int) -> bool:
    """Return whether all boards have one law and no response, and a link is a plane or a cylinder."""
    return len(lay.law_par) == 1 and len(lay.bend) == 0 and len(lay.map_step) == 1 and is_flat(lay.link, link)


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
def reach(laws: Floats, law: int, amplitude: float) -> float:
    """Return the distance beyond which a contact of this amplitude makes no pressure, m."""
    if laws[law, KIND] == CONE:
        return amplitude / float(laws[law, SLOPE])
    return float(laws[law, END])


@inner_kernel
def reach_at(laws: Floats, law: int, log_force: float) -> float:
    """Return the same for a contact of force exp(log_force) N."""
    return reach(laws, law, amplitude(laws, law, log_force)[0] if laws[law, KIND] == CONE else 0.0)


@inner_kernel
def core(laws: Floats, law: int, log_force: float) -> float:
    """Return the distance within which a contact of force exp(log_force) N is coupled to others, m.

    Beyond it lies the skirt of a radial law, too weak to determine a place; a cone has none.
    """
    return reach_at(laws, law, log_force) if laws[law, KIND] == CONE else float(laws[law, CORE])


@inner_kernel
def pressure(
    laws: Floats, tables: Floats, law: int, amplitude: float, d: float
) -> tuple[float, float, float]:
    """Return p (Pa) at distance d, dp/dd, dp/dA; for distances within reach."""
    if laws[law, KIND] == CONE:
        return amplitude - laws[law, SLOPE] * d, -laws[law, SLOPE], 1.0
    k, slope = profile(laws, tables, law, d)
    return amplitude * k, amplitude * slope, k


@inner_kernel
def pressure_beyond(
    laws: Floats, law: int, amplitude: float, d: float, measured: float
) -> tuple[float, float, float]:
    """Return p, dp/dd, dp/dA of the law carried on below zero, for distances beyond its reach.

    A radial law ends where its table does, whatever the force: there the pull is that of the reading
    itself (Pa). Were it in proportion to the amplitude, a tactel out of reach would be an argument for no
    force at all.
    """
    if laws[law, KIND] == CONE:
        return amplitude - laws[law, SLOPE] * d, -laws[law, SLOPE], 1.0
    fall = measured / max(laws[law, END], laws[law, STEP])
    return fall * (laws[law, END] - d), -fall, 0.0


@inner_kernel
def profile(laws: Floats, tables: Floats, law: int, d: float) -> tuple[float, float]:
    """Return k (1/m^2) of a radial law at distance d, and dk/dd; zeros beyond the table."""
    k, slope, _ = curved_profile(laws, tables, law, d)
    return k, slope


@inner_kernel
def curved_profile(laws: Floats, tables: Floats, law: int, d: float) -> tuple[float, float, float]:
    """Return k (1/m^2) of a radial law at distance d, and its two derivatives; zeros beyond the table."""
    if not d <= laws[law, END]:
        return 0.0, 0.0, 0.0
    per_step = laws[law, PER_STEP]
    x = d * per_step
    i = int(min(x, laws[law, LAST]))
    t = x - i
    low, m0, quadratic, bend = tables[law, i, 0], tables[law, i, 1], tables[law, i, 2], tables[law, i, 3]
    k = low + t * (m0 + t * (quadratic + t * bend))
    slope = (m0 + t * (2.0 * quadratic + 3.0 * t * bend)) * per_step
    return k, slope, (2.0 * quadratic + 6.0 * t * bend) * (per_step * per_step)


@inner_kernel
def shape_change(laws: Floats, tables: Floats, law: int, d: float, u: float) -> tuple[float, float, float]:
    """Return what a size u adds to k (1/m^2) at distance d, and its slopes by d and u; 0 beyond the table."""
    if not d < laws[law, END]:
        return 0.0, 0.0, 0.0
    per_step = laws[law, PER_STEP]
    x = d * per_step
    i = int(min(x, laws[law, LAST]))
    t = x - i
    u -= float(laws[law, OWN_SIZE])
    low = m0 = rise = m1 = by_low = by_rise = 0.0
    for mode in range(MODES - 1, -1, -1):
        column = FIRST_MODE + 4 * mode
        g, g_rise = tables[law, i, column], tables[law, i, column + 1]
        low, rise = u * (low + g), u * (rise + g_rise)
        m0, m1 = u * (m0 + tables[law, i, column + 2]), u * (m1 + tables[law, i, column + 3])
        by_low, by_rise = u * by_low + (mode + 1) * g, u * by_rise + (mode + 1) * g_rise
    bend = m0 + m1 - 2.0 * rise
    quadratic = rise - m0 - bend
    return (
        low + t * (m0 + t * (quadratic + t * bend)),
        (m0 + t * (2.0 * quadratic + 3.0 * t * bend)) * per_step,
        by_low + t * by_rise,
    )


@inner_kernel
def peak_pressure(laws: Floats, tables: Floats, law: int, log_force: float) -> float:
    """Return the pressure (Pa) right under a contact."""
    amp, _ = amplitude(laws, law, log_force)
    if laws[law, KIND] == CONE:
        return amp
    return amp * float(tables[law, 0, 0])


@inner_kernel
def affine(laws: Floats, tables: Floats, law: int, d: float) -> tuple[float, float]:
    """Return g and h of p = A g + h at distance d, for tactels known to be in reach."""
    if laws[law, KIND] == CONE:
        return 1.0, -laws[law, SLOPE] * d
    return profile(laws, tables, law, d)[0], 0.0


@inner_kernel
def misfit_at(laws: Floats, tables: Floats, law: int, d: float) -> float:
    """Return the standard deviation of what a law with a misfit profile leaves at distance d, 1/m^2."""
    x, last = d * laws[law, PER_STEP], laws[law, POINTS] - 1.0
    if not x < last:  # the law ends, not what it does not explain
        return float(tables[law, int(last), LEFT])
    i = int(x)
    return float(tables[law, i, LEFT] + (x - i) * tables[law, i, LEFT + 1])


@inner_kernel
def residual_at(lay: Layout, i: int, ds: float, da: float) -> tuple[float, float, float]:
    """Return what tactel i reads beside its law (1/m^2) under a contact at (ds, da) from it, and slopes."""
    row, patch, values = lay.map_of[i], lay.patch[i], lay.map_value
    step, points = lay.map_step[row], lay.map_value.shape[1]
    cos, sin = lay.board[patch, 0], lay.board[patch, 1]
    half = 0.5 * (points - 1)
    u, v = (cos * ds + sin * da) / step + half, (cos * da - sin * ds) / step + half
    # the outermost rows are only neighbours of others
    if not (1.0 <= u < points - 2 and 1.0 <= v < points - 2):
        return 0.0, 0.0, 0.0
    p, q = int(u), int(v)
    x, y = u - p, v - q
    y0, dy0 = catmull_rom(0, y)
    y1, dy1 = catmull_rom(1, y)
    y2, dy2 = catmull_rom(2, y)
    y3, dy3 = catmull_rom(3, y)
    r = r_u = r_v = 0.0
    for a in range(4):
        wx, dx = catmull_rom(a, x)
        k = p - 1 + a
        v0, v1 = values[row, k, q - 1], values[row, k, q]
        v2, v3 = values[row, k, q + 1], values[row, k, q + 2]
        along = y0 * v0 + y1 * v1 + y2 * v2 + y3 * v3
        r += wx * along
        r_u += dx * along
        r_v += wx * (dy0 * v0 + dy1 * v1 + dy2 * v2 + dy3 * v3)
    return r, (cos * r_u - sin * r_v) / step, (sin * r_u + cos * r_v) / step


@inner_kernel
def catmull_rom(a: int, t: float) -> tuple[float, float]:
    """Return the weight of point a of four around t (from 0 to 1, after the second), and its derivative."""
    if a == 0:
        return -0.5 * t * (1.0 - t) * (1.0 - t), -0.5 * (1.0 - t) * (1.0 - 3.0 * t)
    if a == 1:
        return 1.0 + t * t * (1.5 * t - 2.5), t * (4.5 * t - 5.0)
    if a == 2:
        return 0.5 * t * (1.0 + t * (4.0 - 3.0 * t)), 0.5 + t * (4.0 - 4.5 * t)
    return 0.5 * t * t * (t - 1.0), 0.5 * t * (3.0 * t - 2.0)
