"""The normal equations of a fit: what each contact puts into them, and each pair by what both press."""

from __future__ import annotations

from skinbus.estimate.kernels.layout import Floats
from skinbus.estimate.kernels.workspace import Work
from skinbus.jit import inner_kernel


@inner_kernel
def write_normal(w: Work, k: int, normal: Floats, gradient: Floats) -> None:
    """Write J'WJ (its lower half) and J'Wr of k contacts, by s, a, log force of each, as evaluated last."""
    for c in range(k):
        own_block(w, c, normal, gradient)
        for e in range(c):
            shared_block(w, c, e, normal)


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
    n00 = n01 = n02 = n10 = n11 = n12 = n20 = n21 = n22 = 0.0
    m, o, end, end_other = 0, 0, w.n_felt[c], w.n_felt[e]
    while m < end and o < end_other:
        t, to = felt_at[c, m], felt_at[e, o]
        if t != to:  # both lists are in the order of the tactels
            m, o = (m + 1, o) if t < to else (m, o + 1)
            continue
        weight = counts[t]
        x, y, z = weight * felt[c, m, 0], weight * felt[c, m, 1], weight * felt[c, m, 2]
        p, q, r = felt[e, o, 0], felt[e, o, 1], felt[e, o, 2]
        n00, n01, n02 = n00 + x * p, n01 + x * q, n02 + x * r
        n10, n11, n12 = n10 + y * p, n11 + y * q, n12 + y * r
        n20, n21, n22 = n20 + z * p, n21 + z * q, n22 + z * r
        m, o = m + 1, o + 1
    u, v = 3 * c, 3 * e
    normal[u, v], normal[u, v + 1], normal[u, v + 2] = n00, n01, n02
    normal[u + 1, v], normal[u + 1, v + 1], normal[u + 1, v + 2] = n10, n11, n12
    normal[u + 2, v], normal[u + 2, v + 1], normal[u + 2, v + 2] = n20, n21, n22
