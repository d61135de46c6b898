"""What readings at full scale say: the covariance of contacts whose peak is not read.

A reading at full scale is a bound, p >= limit, and no normal error: where the law predicts a little less, the
curvature there claims a force that is sure to a thousandth, yet nothing keeps it from being larger. So the
covariance is first that of the other readings; then each bound is taken in, with the noise of a reading, by
the first two moments of the normal distribution that it cuts (assumed density filtering).

Assumption: the law is nearly linear within the covariance of the other readings. Failure: a contact of which
only readings at full scale are left is as wide as its prior.
Source: C. Rasmussen, C. Williams, Gaussian Processes for Machine Learning (2006), 3.9 (moments of a cut
normal).
"""

from __future__ import annotations

import math

from skinbus.estimate.kernels.covariance import add_prior, invert
from skinbus.estimate.kernels.normal_equations import write_normal
from skinbus.estimate.kernels.workspace import SATURATED, Work
from skinbus.jit import inner_kernel

FAR = -30.0
"""Standard deviations beyond a bound from which on its ratio is taken from the asymptotic series, as exp and
erfc leave the range of floats at 38; its variance is then right to 1 %."""

MOST_CUT = 1.0 - 1e-9
"""Most of a variance that one bound takes: what rounding leaves of the rest is positive."""


@inner_kernel
def censor(w: Work, k: int, n: int) -> None:
    """Write to ``inverse`` the covariance of k contacts, as evaluated last, and to ``step`` mean less mode.

    Only where a listed tactel is at full scale; ``inverse`` and ``step`` stay what they are elsewhere.
    """
    is_cut = False
    for t in range(n):
        if w.state[w.list[t]] == SATURATED:
            is_cut = True
            w.counts[t] = w.pull[t] = 0.0
    if not is_cut:
        return
    write_normal(w, k, w.normal, w.gradient)
    add_prior(w, k)
    invert(w, 3 * k)
    inverse, mean, row, across = w.inverse, w.step, w.gradient_trial, w.pivot
    for u in range(3 * k):
        mean[u] = 0.0
        for v in range(3 * k):
            mean[u] += inverse[u, v] * w.gradient[v]
    for t in range(n):
        if w.state[w.list[t]] != SATURATED:
            continue
        for u in range(3 * k):
            row[u] = 0.0
        for c in range(k):
            for m in range(w.n_felt[c]):
                if w.felt_at[c, m] == t:
                    for x in range(3):
                        row[3 * c + x] = w.felt[c, m, x]
        variance, above = 1.0 / w.weight[t], w.predicted[t] - w.p[w.list[t]]
        for u in range(3 * k):
            across[u] = 0.0
            for v in range(3 * k):
                across[u] += inverse[u, v] * row[v]
        for u in range(3 * k):
            variance += row[u] * across[u]
            above += row[u] * mean[u]
        sd = math.sqrt(variance)
        z = above / sd
        ratio, shrink = cut_normal(z)
        for u in range(3 * k):
            mean[u] += ratio * across[u] / sd
            for v in range(u + 1):
                inverse[u, v] -= shrink * across[u] * across[v] / variance
                inverse[v, u] = inverse[u, v]


@inner_kernel
def cut_normal(z: float) -> tuple[float, float]:
    """Return by how much a standard normal above -z has a larger mean, and by how much less variance."""
    if z < FAR:
        ratio = -z - 1.0 / z + 2.0 / (z * z * z)
    else:
        ratio = math.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * 0.5 * math.erfc(-z / math.sqrt(2.0)))
    return ratio, min(max(ratio * (ratio + z), 0.0), MOST_CUT)
