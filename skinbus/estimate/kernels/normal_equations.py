"""Chi^2 of contacts and its normal equations: what the tactels read, what the law predicts, by which slopes.

The unknowns are s, a, log force of contact after contact. Under a law that was not measured with what presses
(``law.UNSIZED``) the log of the width of each follows, with a normal prior whose square is part of chi^2: a
contact of width w makes p(d / w) / w^2, the same force on more skin or less. A saturated reading counts only
while the law predicts less than its limit.

Assumption: an indenter of another size looks like the law with its distances stretched; discs of 2 to
15 mm on a layer of 6 mm do to 2 % of the peak, of 25 mm to 15 %.
"""

from __future__ import annotations

import math

from skinbus.estimate.budget import DONE
from skinbus.estimate.kernels.geometry import develop, separation, surface_of
from skinbus.estimate.kernels.law import (
    UNSIZED,
    amplitude,
    pressure,
    pressure_beyond,
    reach,
    residual_at,
)
from skinbus.estimate.kernels.layout import Floats, Layout
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.jit import inner_kernel

USUAL_LOG_WIDTH, LOG_WIDTH_SPREAD = 0.05, 0.22
"""Prior of the log width under a law that was learned with fingertips: on a layer of 6 mm a tip of 2 mm makes
it -0.2, a thumb of 25 mm 0.4."""
NARROWEST, WIDEST = 0.5, 3.0
"""Widths that a fit may reach: beyond, the readings tell nothing of a place."""
WIDE = 1.7
"""The widest of several contacts, a thumb of 28 mm: a wider one is what several look like."""


@inner_kernel
def evaluate(
    lay: Layout, w: Work, link: int, theta: Floats, k: int, n: int, normal: Floats, gradient: Floats
) -> tuple[float, bool, float]:
    """Return chi^2 of k contacts ``theta`` on the n listed tactels; write J'WJ (its lower half) and J'Wr.

    Also returns whether any tactel is out of its owner's reach, and how far (m) a contact is off the skin.
    """
    extrapolated = False
    for t in range(n):
        w.predicted[t] = w.background[t]
    for c in range(k):
        extrapolated |= press(lay, w, link, theta, c, n)
    w.work[DONE] += n * k
    chi2 = 0.0
    measured, state, listed, predicted = w.p, w.state, w.list, w.predicted
    weights, counts, pull = w.weight, w.counts, w.pull
    for t in range(n):
        i = listed[t]
        residual = measured[i] - predicted[t]
        if state[i] == SATURATED and residual <= 0.0:
            counts[t] = pull[t] = 0.0
            continue
        counts[t] = weights[t]
        pull[t] = weights[t] * residual
        chi2 += pull[t] * residual
    for c in range(k):
        own_block(w, c, normal, gradient)
        for e in range(c):
            shared_block(w, c, e, normal)
    if has_widths(lay, w):
        for c in range(k):
            chi2 += width_row(lay, w, theta, c, k, normal, gradient)
    return chi2, extrapolated, off_skin(lay, w, link, theta, k)


@inner_kernel
def has_widths(lay: Layout, w: Work) -> bool:
    """Return whether widths are unknowns: some law was not measured with what presses, and none is held."""
    found = False
    if w.widths_held[0]:
        return found
    for law in range(len(lay.law_par)):
        found |= lay.law_par[law, UNSIZED] != 0.0
    return found


@inner_kernel
def n_unknowns(lay: Layout, w: Work, k: int) -> int:
    """Return the unknowns of k contacts."""
    return 4 * k if has_widths(lay, w) else 3 * k


@inner_kernel
def is_sized(lay: Layout, w: Work, c: int) -> bool:
    """Return whether the law of contact c, as pressed last, is that of what presses: its width is held."""
    home = w.nearest_tactel[c]
    return bool(home < 0 or lay.law_par[lay.law[home], UNSIZED] == 0.0)


@inner_kernel
def widest(k: int) -> float:
    """Return the width that each of k contacts may reach."""
    return WIDE if k > 1 else WIDEST


@inner_kernel
def misfit_of_width(width: float) -> float:
    """Return the square of how far a log width is off the middle of its prior, in standard deviations."""
    off = (math.log(width) - USUAL_LOG_WIDTH) / LOG_WIDTH_SPREAD
    return off * off


@inner_kernel
def width_row(lay: Layout, w: Work, theta: Floats, c: int, k: int, normal: Floats, gradient: Floats) -> float:
    """Write what the log width of contact c puts into the normal equations; return the chi^2 of its prior.

    One that is held has a row of zeros.
    """
    felt_at, felt, counts, pull = w.felt_at, w.felt, w.counts, w.pull
    row, width = 3 * k + c, theta[c, 3]
    for v in range(row + 1):
        normal[row, v] = 0.0
    gradient[row] = 0.0
    if is_sized(lay, w, c):
        return 0.0
    own, slope = 0.0, 0.0
    for m in range(w.n_felt[c]):
        t = felt_at[c, m]
        z = felt[c, m, 4]
        slope += z * pull[t]
        own += counts[t] * z * z
    off = (math.log(width) - USUAL_LOG_WIDTH) / LOG_WIDTH_SPREAD
    slope -= off / LOG_WIDTH_SPREAD
    normal[row, row] = own + 1.0 / (LOG_WIDTH_SPREAD * LOG_WIDTH_SPREAD)
    if (width >= widest(k) and slope > 0.0) or (width <= NARROWEST and slope < 0.0):
        return off * off
    gradient[row] = slope
    for e in range(k):
        widths = e <= c
        m, o = 0, 0
        while m < w.n_felt[c] and o < w.n_felt[e]:
            t = felt_at[c, m]
            if t != felt_at[e, o]:  # both lists are in the order of the tactels
                m, o = (m + 1, o) if t < felt_at[e, o] else (m, o + 1)
                continue
            z = counts[t] * felt[c, m, 4]
            for y in range(3):
                normal[row, 3 * e + y] += z * felt[e, o, y]
            if widths and e < c:
                normal[row, 3 * k + e] += z * felt[e, o, 4]
            m, o = m + 1, o + 1
    return off * off


@inner_kernel
def off_skin(lay: Layout, w: Work, link: int, theta: Floats, k: int) -> float:
    """Return how far (m) one of k contacts is off the board of the tactel nearest to it; 0 on them."""
    off_by = 0.0
    for c in range(k):
        if w.nearest_tactel[c] < 0:
            return math.inf
        home = lay.patch[w.nearest_tactel[c]]
        away = off_board(lay, link, home, theta[c])
        off_by = max(off_by, away)
    return off_by


@inner_kernel
def press(lay: Layout, w: Work, link: int, theta: Floats, c: int, n: int) -> bool:
    """Add the pressure of contact c of ``theta`` to ``predicted``; list the tactels it reaches, ``felt_at``.

    For each, ``felt`` has the row of the Jacobian, and its pressure. Returns whether any tactel is out of the
    reach of its owner.
    """
    surface = surface_of(lay.link, link)
    laws, tables, tactel_law, tactel_s, tactel_a = lay.law_par, lay.law_table, lay.law, lay.s, lay.a
    measured, listed, owner, predicted = w.p, w.list, w.owner, w.predicted
    amp, damp, far, felt_at, felt = w.amp, w.damp, w.far, w.felt_at, w.felt
    s, a, log_force, narrow = theta[c, 0], theta[c, 1], theta[c, 2], 1.0 / theta[c, 3]
    spread = narrow * narrow
    for law in range(len(laws)):
        amp[c, law], damp[c, law] = amplitude(laws, law, log_force)
        far[c, law] = reach(laws, law, amp[c, law]) * theta[c, 3]
    extrapolated = False
    home, nearest, m = -1, math.inf, 0
    for t in range(n):
        i = listed[t]
        law = tactel_law[i]
        d2, x, y = separation(surface, s, a, tactel_s[i], tactel_a[i])
        if d2 < nearest:
            nearest, home = d2, i
        own = lay.narrow[i]
        if d2 * own * own <= far[c, law] * far[c, law]:
            d = math.sqrt(d2)
            p, p_d, p_amp = pressure(laws, tables, law, amp[c, law], d * narrow * own)
            p_d *= own
        elif owner[t] == c:
            extrapolated = True
            d = math.sqrt(d2)
            p, p_d, p_amp = pressure_beyond(laws, law, amp[c, law], d * narrow, measured[i])
        else:
            continue
        slope = p_d * spread * narrow / d if d > 0.0 else 0.0
        p_s, p_a = slope * x, slope * y
        if lay.map_of[i] >= 0:
            r, r_s, r_a = residual_at(lay, i, x, y)
            p += amp[c, law] * r
            p_amp += r
            p_s += spread * amp[c, law] * r_s
            p_a += spread * amp[c, law] * r_a
        predicted[t] += spread * p
        felt_at[c, m] = t
        felt[c, m, 0], felt[c, m, 1], felt[c, m, 2] = p_s, p_a, spread * p_amp * damp[c, law]
        felt[c, m, 3] = spread * p
        felt[c, m, 4] = -spread * (2.0 * p + d * narrow * p_d)
        m += 1
    w.nearest_tactel[c], w.n_felt[c] = home, m
    return extrapolated


@inner_kernel
def own_block(w: Work, c: int, normal: Floats, gradient: Floats) -> None:
    """Write what contact c alone puts into the normal matrix and the gradient."""
    felt_at, felt, counts, pull = w.felt_at, w.felt, w.counts, w.pull
    g0 = g1 = g2 = n00 = n10 = n11 = n20 = n21 = n22 = 0.0
    for m in range(w.n_felt[c]):
        t = felt_at[c, m]
        if counts[t] == 0.0:
            continue
        x, y, z = felt[c, m, 0], felt[c, m, 1], felt[c, m, 2]
        g0 += x * pull[t]
        g1 += y * pull[t]
        g2 += z * pull[t]
        u, v = counts[t] * x, counts[t] * y
        n00 += u * x
        n10 += u * y
        n11 += v * y
        n20 += u * z
        n21 += v * z
        n22 += counts[t] * z * z
    u = 3 * c
    gradient[u], gradient[u + 1], gradient[u + 2] = g0, g1, g2
    normal[u, u], normal[u + 1, u], normal[u + 1, u + 1] = n00, n10, n11
    normal[u + 2, u], normal[u + 2, u + 1], normal[u + 2, u + 2] = n20, n21, n22


@inner_kernel
def shared_block(w: Work, c: int, e: int, normal: Floats) -> None:
    """Write to the normal matrix what contacts c and e put into it by the tactels that feel both."""
    felt_at, felt, counts = w.felt_at, w.felt, w.counts
    u, v = 3 * c, 3 * e
    for x in range(3):
        for y in range(3):
            normal[u + x, v + y] = 0.0
    m, o = 0, 0
    while m < w.n_felt[c] and o < w.n_felt[e]:
        t = felt_at[c, m]
        if t != felt_at[e, o]:  # both lists are in the order of the tactels
            m, o = (m + 1, o) if t < felt_at[e, o] else (m, o + 1)
            continue
        for x in range(3):
            row = counts[t] * felt[c, m, x]
            for y in range(3):
                normal[u + x, v + y] += row * felt[e, o, y]
        m, o = m + 1, o + 1


@inner_kernel
def off_board(lay: Layout, link: int, patch: int, place: Floats) -> float:
    """Return how far (m) a place (s, a) is off the board of a patch, the seam around it included; 0 on it."""
    board, surface = lay.board, surface_of(lay.link, link)
    x, y = develop(surface, place[0], place[1], lay.patch_a[patch])
    x -= lay.patch_s[patch]
    u = board[patch, 0] * x + board[patch, 1] * y
    v = board[patch, 0] * y - board[patch, 1] * x
    return float(max(abs(u) - board[patch, 2], abs(v) - board[patch, 3], 0.0))
