"""What the tactels of a group read under k contacts, with its derivatives, and how uncertain each reading is.

::

    p_i = b_patch + sum_k A(F_k) g_i(d_ik; u_k) + noise        unknowns of a contact: s, a, log F and size u

with A, g and the h of a cone in ``kernels.law``. b_patch ~ N(0, offset_variance) is eliminated: with weights
w_i and B = 1 / (sum w_i + 1 / offset_variance) over the tactels of a board, chi^2 is less by B (sum w_i
r_i)^2 and the normal matrix by B (sum w_i J_i)(sum w_i J_i)'.

Variances are those of :func:`weigh`, the same for all rivals: noise, the gains, and what the law cannot
explain. A reading at full scale counts while the model predicts less. The misfit of a learned law has tails,
those of Student's t with ``TAIL`` degrees of freedom, noise has none: if misfit makes a part f of the
variance, the sum has the kurtosis of a t with 4 + (TAIL - 4) / f^2 degrees of freedom. chi^2 is then nu
log(1 + r^2 / (nu variance)), r^2 / variance where that is small, and weights are those of iterated least
squares.

Source: K. Lange, R. Little, J. Taylor, Robust statistical modeling using the t distribution (1989).
"""

from __future__ import annotations

import math

from skinbus.arrays import Floats
from skinbus.estimate.budget import DONE
from skinbus.estimate.kernels.geometry import distance, separation, surface_of
from skinbus.estimate.kernels.law import amplitude, misfit_at, pressure, reach, residual_at
from skinbus.estimate.kernels.layout import MISFIT, PEAK, ROOT_MISFIT, SHAPED, TAILED, Layout
from skinbus.estimate.kernels.workspace import SATURATED, Search, Work
from skinbus.jit import inner_kernel
from skinbus.model.bend_kernel import bend_at

MOST_PEAK = 10.0
"""Times the largest reading, the highest peak whose misfit counts: a contact beside its tactels explains
anything with more."""
TAIL = 5.0
"""Degrees of freedom: presses of real arrays, held out, have errors with tails of 4 to 6."""
LEAST_TAILED = 1e-6
"""Squared part of the variance: below it errors are Gaussian in all digits that count."""


@inner_kernel
def press(lay: Layout, q: Search, link: int, theta: Floats, c: int, to: Floats, column: int) -> None:
    """Add the pressure (Pa) of contact c of ``theta`` to ``to``.

    If ``column`` is 0 or more it is the contact's number in the Jacobian, which is written, with ``felt_by``.
    """
    surface, laws, jac, dof = surface_of(lay.link, link), lay.law_par, q.jacobian, q.dof[0]
    s, a, log_force, size = theta[c, 0], theta[c, 1], theta[c, 2], theta[c, 3]
    is_bent, is_mapped = len(lay.bend) > 0, len(lay.map_step) > 1
    first, last, amp, damp, far = column * dof, -1, 0.0, 0.0, 0.0
    for t in range(q.n_listed[0]):
        i = q.listed[t]
        law = lay.law[i]
        if law != last:
            amp, damp = amplitude(laws, law, log_force)
            far, last = reach(laws, law, amp), law
        d2, x, y = separation(surface, s, a, lay.s[i], lay.a[i])
        own, own_s, own_a = lay.narrow[i], 0.0, 0.0
        if is_bent:
            factor, own_s, own_a = bend_at(lay.bend, i, x, y)
            own, own_s, own_a = own * factor, own * own_s, own * own_a
        if d2 * own * own >= far * far:
            continue
        d = math.sqrt(d2)
        p, p_d, p_amp, by_size = pressure(laws, lay.law_table, law, amp, d * own, size)
        slope = own * p_d / d if d > 0.0 else 0.0
        p_s, p_a = slope * x + p_d * d * own_s, slope * y + p_d * d * own_a
        if is_mapped and lay.map_of[i] >= 0:
            r, r_s, r_a = residual_at(lay, i, x, y)
            p, p_amp, p_s, p_a = p + amp * r, p_amp + r, p_s + amp * r_s, p_a + amp * r_a
        to[t] += p
        if column >= 0:
            q.felt_by[t, q.n_felt_by[t]] = column
            q.n_felt_by[t] += 1
            jac[t, first], jac[t, first + 1], jac[t, first + 2] = p_s, p_a, p_amp * damp
            if dof == 4:
                jac[t, first + 3] = by_size


@inner_kernel
def feels(q: Search, t: int, c: int) -> bool:
    """Return whether listed tactel t feels contact c of those pressed last."""
    found = False
    for x in range(q.n_felt_by[t]):
        found |= q.felt_by[t, x] == c
    return found


@inner_kernel
def weigh(lay: Layout, w: Work, q: Search, link: int, theta: Floats, k: int) -> None:
    """Write the variance of each listed reading beside k contacts ``theta``."""
    laws, surface, most, n = lay.law_par, surface_of(lay.link, link), 0.0, q.n_listed[0]
    for t in range(n):
        most = max(most, w.p[q.listed[t]])
    for t in range(n):
        i = q.listed[t]
        row, reading = laws[lay.law[i]], w.p[i]
        noise, wrong = lay.sigma[i] * lay.sigma[i], row[MISFIT] * reading
        variance = noise + wrong * wrong
        for c in range(k if row[SHAPED] != 0.0 else 0):
            amp = min(amplitude(laws, lay.law[i], theta[c, 2])[0], MOST_PEAK * most / row[PEAK])
            d = distance(surface, theta[c, 0], theta[c, 1], lay.s[i], lay.a[i])
            wrong = amp * misfit_at(laws, lay.law_table, lay.law[i], d)
            variance += wrong * wrong + row[ROOT_MISFIT] * amp * max(reading, 0.0)
        q.variance[t] = variance
        part = 1.0 - noise / variance
        tail = 4.0 + (TAIL - 4.0) / max(part * part, LEAST_TAILED) if row[TAILED] != 0.0 else 0.0
        q.tail[t] = TAIL if q.tailed[0] else tail


@inner_kernel
def predict(lay: Layout, w: Work, q: Search, link: int, theta: Floats, k: int) -> float:
    """Return chi^2 of k contacts ``theta`` over the listed tactels; write Jacobian, weights and residuals."""
    n, pull, weight = q.n_listed[0], q.pull, q.weight
    for t in range(n):
        pull[t] = q.back[t]
        q.n_felt_by[t] = 0
    for c in range(k):
        press(lay, q, link, theta, c, pull, c)
    w.work[DONE] += n * k
    chi2, t = 0.0, 0
    while t < n:
        patch, first, sum_w, sum_wr = lay.patch[q.listed[t]], t, 0.0, 0.0
        while t < n and lay.patch[q.listed[t]] == patch:
            i = q.listed[t]
            r = w.p[i] - pull[t]
            pull[t], weight[t] = r, 0.0
            if w.state[i] != SATURATED or r > 0.0:
                weight[t] = 1.0 / q.variance[t]
                square = weight[t] * r * r
                if q.tail[t] > 0.0:
                    part = q.tail[t] / (q.tail[t] + square)
                    weight[t], square = weight[t] * part, -q.tail[t] * math.log(part)
                chi2 += square
                sum_w, sum_wr = sum_w + weight[t], sum_wr + weight[t] * r
            t += 1
        prior = w.offset_variance[patch] * q.offsets[0]
        if prior > 0.0:
            offset = sum_wr * prior / (sum_w * prior + 1.0)
            chi2 -= offset * sum_wr
            for u in range(first, t):
                pull[u] -= offset
    return chi2


@inner_kernel
def write_normal(lay: Layout, w: Work, q: Search, k: int) -> None:
    """Write J'WJ (its lower half) and J'Wr of the contacts predicted last."""
    dof, n = q.dof[0], q.n_listed[0]
    m, normal, gradient, jac, row = dof * k, q.normal, q.gradient, q.jacobian, q.row
    for u in range(m):
        gradient[u] = row[u] = 0.0
        for v in range(u + 1):
            normal[u, v] = 0.0
    t = 0
    while t < n:
        patch, sum_w = lay.patch[q.listed[t]], 0.0
        while t < n and lay.patch[q.listed[t]] == patch:
            weight = q.weight[t]
            sum_w += weight
            if weight > 0.0:
                pull = weight * q.pull[t]
                for x in range(q.n_felt_by[t]):
                    c = dof * q.felt_by[t, x]
                    for u in range(c, c + dof):
                        slope = weight * jac[t, u]
                        gradient[u] += pull * jac[t, u]
                        row[u] += slope
                        for y in range(x + 1):  # contacts are listed in rising order
                            e = dof * q.felt_by[t, y]
                            for v in range(e, min(e + dof, u + 1)):
                                normal[u, v] += slope * jac[t, v]
            t += 1
        prior = w.offset_variance[patch] * q.offsets[0]
        part = prior / (sum_w * prior + 1.0)
        for u in range(m if prior > 0.0 else 0):
            if row[u] != 0.0:
                for v in range(u + 1):
                    normal[u, v] -= part * row[u] * row[v]
        for u in range(m):
            row[u] = 0.0
