"""The model of a group: pressures under k contacts with their derivatives, and the variance of each reading.

::

    p_i = b_patch + sum_k A(F_k) g_i(d_ik; u_k) + noise        unknowns of a contact: s, a, log F and size u

A, g and the h of a cone are in ``kernels.law``. Offsets of boards, b_patch ~ N(0, offset_variance), are
eliminated. With weights w_i, residuals r_i, rows J_i of the Jacobian and B = 1 / (sum w_i + 1 /
offset_variance) over the tactels of a board, chi^2 decreases by B (sum w_i r_i)^2, and the normal matrix by
B (sum w_i J_i)(sum w_i J_i)'.

:func:`weigh` sets the variances, once for all rivals: noise, gains, and the misfit of the law, which is the
part of the readings that it cannot explain. A reading at full scale is a lower bound: it has no weight while
the model predicts more.

Tails: the misfit of a learned law has those of Student's t with ``TAIL`` degrees of freedom, noise has none.
If misfit is a share f of the variance V, their sum has the kurtosis of a t with nu = 4 + (TAIL - 4) / f^2
degrees of freedom. The term of a residual r in chi^2 is then nu log(1 + r^2 / (nu V)), which is r^2 / V for
small r. Its weight is that of iteratively reweighted least squares, 1 / (V + r^2 / nu).

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
"""The misfit of a contact counts up to a peak of so many times the largest reading: otherwise a strong
contact off the tactels has variances that explain any readings."""
TAIL = 5.0
"""Degrees of freedom of the misfit: held-out presses of real arrays have 4 to 6."""
LEAST_TAILED = 1e-6
"""Least f^2, against a division by zero: a t with a million degrees of freedom is Gaussian."""


@inner_kernel
def press(lay: Layout, q: Search, link: int, theta: Floats, c: int, to: Floats, column: int) -> None:
    """Add the pressure (Pa) of contact c of ``theta`` to ``to``, along the listed tactels.

    If ``column`` is not negative, write its derivatives as contact ``column`` of the Jacobian, and
    ``felt_by``.

    The law is read at the distance times ``stretch``, of the tactel's width and the chart of a mesh.
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
        stretch, stretch_s, stretch_a = lay.narrow[i], 0.0, 0.0
        if is_bent:
            bend, bend_s, bend_a = bend_at(lay.bend, i, x, y)
            stretch, stretch_s, stretch_a = stretch * bend, stretch * bend_s, stretch * bend_a
        if d2 * stretch * stretch >= far * far:
            continue
        d = math.sqrt(d2)
        p, p_d, p_amp, by_size = pressure(laws, lay.law_table, law, amp, d * stretch, size)
        slope = stretch * p_d / d if d > 0.0 else 0.0
        p_s, p_a = slope * x + p_d * d * stretch_s, slope * y + p_d * d * stretch_a
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
    """Return whether contact c of those predicted last reaches listed tactel t."""
    found = False
    for x in range(q.n_felt_by[t]):
        found |= q.felt_by[t, x] == c
    return found


@inner_kernel
def weigh(lay: Layout, w: Work, q: Search, link: int, theta: Floats, k: int) -> None:
    """Write the variance of each listed reading under k contacts ``theta``, and its degrees of freedom."""
    laws, surface, most, n = lay.law_par, surface_of(lay.link, link), 0.0, q.n_listed[0]
    for t in range(n):
        most = max(most, w.p[q.listed[t]])
    for t in range(n):
        i = q.listed[t]
        row, reading = laws[lay.law[i]], w.p[i]
        noise, misfit = lay.sigma[i] * lay.sigma[i], row[MISFIT] * reading
        variance = noise + misfit * misfit
        for c in range(k if row[SHAPED] != 0.0 else 0):
            amp = min(amplitude(laws, lay.law[i], theta[c, 2])[0], MOST_PEAK * most / row[PEAK])
            d = distance(surface, theta[c, 0], theta[c, 1], lay.s[i], lay.a[i])
            misfit = amp * misfit_at(laws, lay.law_table, lay.law[i], d)
            variance += misfit * misfit + row[ROOT_MISFIT] * amp * max(reading, 0.0)
        q.variance[t] = variance
        share = 1.0 - noise / variance
        tail = 4.0 + (TAIL - 4.0) / max(share * share, LEAST_TAILED) if row[TAILED] != 0.0 else 0.0
        q.tail[t] = TAIL if q.tailed[0] else tail


@inner_kernel
def predict(lay: Layout, w: Work, q: Search, link: int, theta: Floats, k: int) -> float:
    """Return chi^2 of k contacts ``theta`` over the listed tactels; write Jacobian, weights and residuals."""
    n, residual, weight = q.n_listed[0], q.residual, q.weight
    for t in range(n):
        residual[t] = q.outside[t]  # first the prediction
        q.n_felt_by[t] = 0
    for c in range(k):
        press(lay, q, link, theta, c, residual, c)
    w.work[DONE] += n * k
    chi2, t = 0.0, 0
    while t < n:
        patch, first, sum_w, sum_wr = lay.patch[q.listed[t]], t, 0.0, 0.0
        while t < n and lay.patch[q.listed[t]] == patch:
            i = q.listed[t]
            r = w.p[i] - residual[t]
            residual[t], weight[t] = r, 0.0
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
                residual[u] -= offset
    return chi2


@inner_kernel
def write_normal(lay: Layout, w: Work, q: Search, k: int) -> None:
    """Write J'WJ (its lower half) and J'Wr of the contacts predicted last."""
    dof, n = q.dof[0], q.n_listed[0]
    m, normal, gradient, jac, sums = dof * k, q.normal, q.gradient, q.jacobian, q.scratch
    for u in range(m):
        gradient[u] = sums[u] = 0.0
        for v in range(u + 1):
            normal[u, v] = 0.0
    t = 0
    while t < n:
        patch, sum_w = lay.patch[q.listed[t]], 0.0
        while t < n and lay.patch[q.listed[t]] == patch:
            weight = q.weight[t]
            sum_w += weight
            if weight > 0.0:
                residual = weight * q.residual[t]
                for x in range(q.n_felt_by[t]):
                    c = dof * q.felt_by[t, x]
                    for u in range(c, c + dof):
                        slope = weight * jac[t, u]
                        gradient[u] += residual * jac[t, u]
                        sums[u] += slope
                        for y in range(x + 1):  # contacts are listed in rising order
                            e = dof * q.felt_by[t, y]
                            for v in range(e, min(e + dof, u + 1)):
                                normal[u, v] += slope * jac[t, v]
            t += 1
        prior = w.offset_variance[patch] * q.offsets[0]
        part = prior / (sum_w * prior + 1.0)
        for u in range(m if prior > 0.0 else 0):
            if sums[u] != 0.0:
                for v in range(u + 1):
                    normal[u, v] -= part * sums[u] * sums[v]
        for u in range(m):
            sums[u] = 0.0
