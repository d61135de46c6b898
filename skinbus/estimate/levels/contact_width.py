"""Contacts wider than the law: one more number for a contact that the law as calibrated does not explain.

A thumb presses more skin than the tip the law was learned with, and a law that is a little too sharp
looks the same. Where a fit leaves more than noise, a contact's pressure may spread out, p(d / w) / w^2, by
a few steps, if that lowers chi^2. Without this a wide contact is explained by several narrow ones.

Assumption: a wider contact looks like the law with its distances stretched, which holds for indenters up
to a few layer thicknesses. Widths below 1 are not tried: there are two contacts too close together.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import is_over
from skinbus.estimate.kernels.geometry import distance, surface_of
from skinbus.estimate.kernels.law import peak_pressure
from skinbus.estimate.kernels.layout import Layout
from skinbus.estimate.kernels.least_squares import OFF_SKIN, ROUGH, evaluate, fit
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.estimate.levels.split_merge import clear_owners, copy_rows, own_nearest
from skinbus.jit import inner_kernel, runtime_int

WIDTHS = (1.26, 1.6, 2.0, 2.5)
STEP = 1.12
"""Widths tried, and half way to the next, up and down, from the best of them."""
WIDEST = 3.0
"""A palm. Beyond, the readings are flat and do not determine a place."""
WORTH_WIDTH = 16.0
"""chi^2 that a width must save: one parameter, four standard deviations."""
LIKE = 0.03
"""Root mean square of what gains and the law leave, as a part of the pressures; a thumb leaves 9 %."""
GOOD = 2.5
"""Standard deviations above its mean up to which a chi^2 is as expected: nothing more is tried."""
WIDTH_ITERATIONS = 8
WIDTH_MOVE = 0.005
"""One step of these fits, m: a contact that becomes wider stays where it is."""


@inner_kernel
def expected(k: int, n: int) -> float:
    """Return the chi^2 up to which an answer with k contacts on n tactels is as good as the right one."""
    freedom = max(n - 3 * k, 1)
    return freedom + GOOD * math.sqrt(2.0 * freedom)


@inner_kernel
def seen(lay: Layout, w: Work, link: int, c: int, n: int) -> bool:
    """Return whether contact c of ``theta`` rests on the tactels listed, more or less.

    Its force at its peak pressure covers a disc; that must not reach further than the furthest tactel. A
    flat field fits any contact wide enough, and most of such a one would be where nothing is read.
    """
    if w.nearest_tactel[c] < 0:
        return False
    surface, theta, law = surface_of(lay.link, link), w.theta, lay.law[w.nearest_tactel[c]]
    furthest = 0.0
    for t in range(n):
        i = w.list[t]
        d = distance(surface, theta[c, 0], theta[c, 1], lay.s[i], lay.a[i])
        furthest = max(furthest, d)
    peak = peak_pressure(lay.law_par, lay.law_table, law, theta[c, 2]) / (theta[c, 3] * theta[c, 3])
    return bool(math.exp(theta[c, 2]) <= math.pi * furthest * furthest * peak)


@inner_kernel
def unlike(lay: Layout, w: Work, link: int, k: int, n: int) -> bool:
    """Return whether the k contacts of ``theta`` leave more than gains and the shape of a law leave.

    A strong touch shows errors of the law that are small beside it, and far from noise. A width does mend
    them: a wide contact far off the tactels makes nearly every field.
    """
    clear_owners(w, n)
    evaluate(lay, w, link, w.theta, k, n, w.normal, w.gradient)
    left, energy = 0.0, 0.0
    for t in range(n):
        i = w.list[t]
        residual = w.p[i] - w.predicted[t]
        if w.state[i] == SATURATED:
            residual = max(residual, 0.0)
        left += residual * residual
        energy += w.p[i] * w.p[i]
    return bool(left > LIKE * LIKE * energy)


@inner_kernel
def widen(lay: Layout, w: Work, link: int, k: int, n: int, chi2: float) -> float:
    """Widen the k contacts of ``theta`` where it saves enough; return chi^2."""
    theta, before, wide, limit = w.theta, w.before, w.wide, runtime_int(WIDTH_ITERATIONS)
    if chi2 <= expected(k, n) or is_over(w) or not unlike(lay, w, link, k, n):
        return chi2
    for c in range(k):
        if chi2 <= expected(k, n) or is_over(w):
            break
        copy_rows(theta, before, k)
        copy_rows(theta, wide, k)
        best = chi2
        first = before[c, 3]
        for turn in range(len(WIDTHS) + 2):
            if is_over(w):
                break
            copy_rows(wide, theta, k)
            if turn < len(WIDTHS):
                theta[c, 3] = first * WIDTHS[turn]
            else:
                theta[c, 3] *= STEP if turn == len(WIDTHS) else 1.0 / STEP
            if theta[c, 3] > WIDEST or theta[c, 3] < first:
                continue
            own_nearest(lay, w, link, k, n)
            wider, status, _ = fit(lay, w, link, k, n, WIDTH_MOVE, limit, ROUGH, best)
            if wider < best and status != OFF_SKIN and seen(lay, w, link, c, n):
                best = wider
                copy_rows(theta, wide, k)
        if chi2 - best > WORTH_WIDTH:
            chi2 = best
            # from where the wide contact found its place, the law's own width may do as well
            copy_rows(wide, theta, k)
            theta[c, 2] -= 2.0 * math.log(theta[c, 3] / first)
            theta[c, 3] = first
            own_nearest(lay, w, link, k, n)
            beat = best + WORTH_WIDTH
            narrow, status, _ = fit(lay, w, link, k, n, WIDTH_MOVE, limit, ROUGH, beat)
            if narrow <= beat and status != OFF_SKIN:
                chi2 = narrow
            else:
                copy_rows(wide, theta, k)
        else:
            copy_rows(before, theta, k)
    return chi2
