"""Readings under contacts whose size is an unknown: their pressures, slopes and normal equations.

The size u of a contact changes its law by the modes of ``disc_shapes``; a law that has none stays as it is.

What a law that was learned leaves at a place is not normal: hysteresis, zeros that have moved and tactels of
their own kind make a few readings 5 to 10 of its standard deviations off. There chi^2 has, in place of the
square z^2 of a residual, T log(1 + z^2 / T): Student's t of T - 1 degrees of freedom, of unit weight at 0.

Source: K. Lange, R. Little, J. Taylor, Robust statistical modeling using the t distribution (1989),
doi:10.1080/01621459.1989.10478852.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import DONE
from skinbus.estimate.kernels.board_places import off_board
from skinbus.estimate.kernels.constants import FORCE_WIDTH
from skinbus.estimate.kernels.geometry import flat_of, separation, surface_of
from skinbus.estimate.kernels.law import (
    KIND,
    PROFILED,
    SHAPED,
    TYPICAL,
    amplitude,
    is_plain,
    pressure,
    profile,
    reach,
    residual_at,
    shape_change,
)
from skinbus.estimate.kernels.layout import CONE, Floats, Layout
from skinbus.estimate.kernels.normal_equations import write_normal
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.jit import inner_kernel
from skinbus.model.bend import bend_at

TAIL = 5.0
"""T: a degree more than that of the posterior over cells (``FREEDOM`` of ``posterior_cell``)."""


@inner_kernel
def evaluate_sized(
    lay: Layout,
    w: Work,
    link: int,
    theta: Floats,
    k: int,
    n: int,
    size: float,
    spread: float,
    normal: Floats,
    gradient: Floats,
) -> tuple[float, float]:
    """Return chi^2 with the prior of sizes in it, and how far (m) a contact of ``theta`` is off the skin.

    Writes the normal equations of s, a, log force of each contact and then of all sizes.
    """
    felt, felt_at, counts, pull = w.felt, w.felt_at, w.counts, w.pull
    for t in range(n):
        w.predicted[t] = w.background[t]
    plain, off_by = is_plain(lay, link), 0.0
    for c in range(k):
        if plain:
            press_sized(lay, w, link, theta, c, n, 1)
        else:
            press_sized(lay, w, link, theta, c, n, 0)
        if w.nearest_tactel[c] < 0:
            return math.inf, math.inf
        off_by = max(off_by, off_board(lay, link, lay.patch[w.nearest_tactel[c]], theta[c]))
    w.work[DONE] += n * k
    chi2 = 0.0
    for t in range(n):
        i = w.list[t]
        residual = w.p[i] - w.predicted[t]
        if w.state[i] == SATURATED and residual <= 0.0:
            counts[t] = pull[t] = 0.0
            continue
        counts[t] = w.weight[t]
        pull[t] = w.weight[t] * residual
        square = pull[t] * residual
        if lay.law_par[lay.law[i], PROFILED] != 0.0:
            part = TAIL / (TAIL + square)
            counts[t], pull[t] = counts[t] * part, pull[t] * part
            square = -TAIL * math.log(part)
        chi2 += square
    write_normal(w, k, normal, gradient)
    for c in range(k):
        row = 3 * k + c
        off = (theta[c, 3] - size) / spread
        chi2 += off * off
        own, slope, by_s, by_a, by_force = 1.0 / (spread * spread), -off / spread, 0.0, 0.0, 0.0
        chi2 += weigh_force(lay, w, theta, c, normal, gradient)
        for m in range(w.n_felt[c]):
            t, z = felt_at[c, m], felt[c, m, 3]
            slope += z * pull[t]
            weighted = counts[t] * z
            own += weighted * z
            by_s += weighted * felt[c, m, 0]
            by_a += weighted * felt[c, m, 1]
            by_force += weighted * felt[c, m, 2]
        normal[row, 3 * c], normal[row, 3 * c + 1], normal[row, 3 * c + 2] = by_s, by_a, by_force
        for e in range(k):
            if e == c:
                continue
            for x in range(3):
                normal[row, 3 * e + x] = 0.0
            if e < c:
                normal[row, 3 * k + e] = 0.0
            m, o = 0, 0
            while m < w.n_felt[c] and o < w.n_felt[e]:
                t = felt_at[c, m]
                if t != felt_at[e, o]:  # both lists are in the order of the tactels
                    m, o = (m + 1, o) if t < felt_at[e, o] else (m, o + 1)
                    continue
                z = counts[t] * felt[c, m, 3]
                for x in range(3):
                    normal[row, 3 * e + x] += z * felt[e, o, x]
                if e < c:
                    normal[row, 3 * k + e] += z * felt[e, o, 3]
                m, o = m + 1, o + 1
        normal[row, row], gradient[row] = own, slope
    return chi2, off_by


@inner_kernel
def weigh_force(lay: Layout, w: Work, theta: Floats, c: int, normal: Floats, gradient: Floats) -> float:
    """Add the prior of the force of contact c to the normal equations if its law has one; return its chi^2.

    It is that of the posterior over cells: a factor e about the forces that the law was learned with.
    """
    typical = float(lay.law_par[lay.law[w.nearest_tactel[c]], TYPICAL])
    if not typical > 0.0:
        return 0.0
    off = (theta[c, 2] - math.log(typical)) / FORCE_WIDTH
    gradient[3 * c + 2] -= off / FORCE_WIDTH
    normal[3 * c + 2, 3 * c + 2] += 1.0 / (FORCE_WIDTH * FORCE_WIDTH)
    return float(off * off)


@inner_kernel
def press_sized(lay: Layout, w: Work, link: int, theta: Floats, c: int, n: int, plain: int) -> None:
    """Add the pressure of contact c of ``theta`` to ``predicted``; list the tactels it reaches, ``felt_at``.

    For each, ``felt`` has the derivatives by s, a, log force and size. ``plain`` is that of :func:`press`.
    """
    surface = flat_of(lay.link, link) if plain else surface_of(lay.link, link)
    laws, tables, listed, predicted = lay.law_par, lay.law_table, w.list, w.predicted
    tactel_law, map_of, felt_at, felt = lay.law, lay.map_of, w.felt_at, w.felt
    at_s, at_a, tactel_narrow = w.listed_s, w.listed_a, w.listed_narrow
    s, a, log_force, size = theta[c, 0], theta[c, 1], theta[c, 2], theta[c, 3]
    is_bent, is_mapped = not plain and len(lay.bend) > 0, not plain and len(lay.map_step) > 1
    home, nearest, m = -1, math.inf, 0
    last, amp, damp, far = -1, 0.0, 0.0, 0.0
    for t in range(n):
        law = 0 if plain else tactel_law[listed[t]]
        if law != last:
            amp, damp = amplitude(laws, law, log_force)
            far, last = reach(laws, law, amp), law
        d2, x, y = separation(surface, s, a, at_s[t], at_a[t])
        if d2 < nearest:
            nearest, home = d2, t
        own, own_s, own_a = tactel_narrow[t], 0.0, 0.0
        if is_bent:
            factor, own_s, own_a = bend_at(lay.bend, listed[t], x, y)
            own, own_s, own_a = own * factor, own * own_s, own * own_a
        if d2 * own * own > far * far:
            continue
        d = math.sqrt(d2)
        per_d = 1.0 / d if d > 0.0 else 0.0
        p, p_d, p_amp = pressure(laws, tables, law, amp, d * own)
        by_size = 0.0
        if laws[law, SHAPED] != 0.0:
            g, g_d, g_size = shape_change(laws, tables, law, d * own, size)
            p += amp * g
            p_d += amp * g_d
            p_amp += g
            by_size = amp * g_size
        slope = own * p_d * per_d
        p_s, p_a = slope * x, slope * y
        if is_bent:
            p_s, p_a = p_s + p_d * d * own_s, p_a + p_d * d * own_a
        if is_mapped and map_of[listed[t]] >= 0:
            r, r_s, r_a = residual_at(lay, listed[t], x, y)
            p += amp * r
            p_amp += r
            p_s += amp * r_s
            p_a += amp * r_a
        predicted[t] += p
        felt_at[c, m] = t
        felt[c, m, 0], felt[c, m, 1], felt[c, m, 2] = p_s, p_a, p_amp * damp
        felt[c, m, 3] = by_size
        m += 1
    w.nearest_tactel[c], w.n_felt[c] = listed[home] if home >= 0 else -1, m


@inner_kernel
def width_of(lay: Layout, home: int, size: float) -> tuple[float, float]:
    """Return how much wider than the law of tactel ``home`` a size is, by its peak, and the slope by size."""
    law = lay.law[home]
    peak, _ = profile(lay.law_par, lay.law_table, law, 0.0)
    if lay.law_par[law, KIND] == CONE or lay.law_par[law, SHAPED] == 0.0 or not peak > 0.0:
        return 1.0, 0.0
    change, _, by_size = shape_change(lay.law_par, lay.law_table, law, 0.0, size)
    part = max(1.0 + change / peak, 0.01)
    width = 1.0 / math.sqrt(part)
    return width, -0.5 * width / part * by_size / peak
