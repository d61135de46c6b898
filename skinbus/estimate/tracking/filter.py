"""The Kalman filter of one track: place, velocity and force, with the covariance kept as U D U'.

State x = (s, a, ds/dt, da/dt, force). Between cycles the velocity is constant but for white acceleration
and the force walks at random::

    x <- Phi x,   P <- Phi P Phi' + Q(dt),   Q of one axis = q [[dt^3/3, dt^2/2], [dt^2/2, dt]]

P = U D U' with U unit upper triangular and D diagonal. Both steps work on U and D alone: a product of
positive numbers stays positive, so P is symmetric and positive definite by its form however long it runs;
no subtraction can spoil it.

Source: G. J. Bierman, Factorization Methods for Discrete Sequential Estimation (1977): sections V.3
(measurement) and VI.4 (Thornton's time step by weighted Gram-Schmidt).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]

N = 5
"""States."""
S, A, VS, VA, F = range(N)
M = 3
"""Measured: s, a, force."""


@inner_kernel
def predict(
    x: Floats, U: Floats, D: Floats, dt: float, q_s: float, q_a: float, q_f: float, W: Floats, Dw: Floats
) -> None:
    """Carry a state on by dt > 0 s.

    q_s, q_a, q_f: spectral densities of the noise, m^2/s^3, m^2/s^3, N^2/s
    W, Dw:         (5, 10), (10,) scratch
    """
    x[S] += dt * x[VS]
    x[A] += dt * x[VA]
    # W = [Phi U, G] and Dw = [D, Dq] with Q = G Dq G': the exact factors of Q of one axis.
    for i in range(N):
        for j in range(N):
            W[i, j] = 0.0 if j < i else (1.0 if i == j else U[i, j])
            W[i, N + j] = 1.0 if i == j else 0.0
        Dw[i] = D[i]
    for j in range(N):
        W[S, j] += dt * W[VS, j]
        W[A, j] += dt * W[VA, j]
    W[S, N + VS] = 0.5 * dt
    W[A, N + VA] = 0.5 * dt
    Dw[N + S] = q_s * dt * dt * dt / 12.0
    Dw[N + A] = q_a * dt * dt * dt / 12.0
    Dw[N + VS] = q_s * dt
    Dw[N + VA] = q_a * dt
    Dw[N + F] = q_f * dt
    for j in range(N - 1, -1, -1):
        d = 0.0
        for k in range(2 * N):
            d += W[j, k] * W[j, k] * Dw[k]
        D[j] = d
        for i in range(j):
            c = 0.0
            for k in range(2 * N):
                c += W[i, k] * W[j, k] * Dw[k]
            c /= d
            U[i, j] = c
            for k in range(2 * N):
                W[i, k] -= c * W[j, k]


@inner_kernel
def correct(
    x: Floats, U: Floats, D: Floats, y: Floats, R: Floats, h: Floats, gain: Floats, dx: Floats
) -> None:
    """Take in a measurement of (s, a, force): its innovation y (3,), its covariance R (3, 3) > 0.

    The measurements are taken one by one after R = L Dr L' has made them independent; L and Dr overwrite R.
    h, gain, dx are (5,) scratch; x becomes x + dx.
    """
    _factor(R)
    for i in range(N):
        dx[i] = 0.0
    for k in range(M):
        # Row k of inv(L) (H, y), from the factor that R holds below its diagonal.
        for i in range(N):
            h[i] = 0.0
        h[_state_of(k)] = 1.0
        e = y[k]
        for m in range(k - 1, -1, -1):
            # inv(L)[k, m], computed for 3 x 3: -L10; -L21; L21 L10 - L20
            c = -R[k, m]
            if k == 2 and m == 0:
                c += R[2, 1] * R[1, 0]
            h[_state_of(m)] = c
            e += c * y[m]
        for i in range(N):
            e -= h[i] * dx[i]
        _scalar(U, D, h, R[k, k], e, gain, dx)
    for i in range(N):
        x[i] += dx[i]


@inner_kernel
def covariance(U: Floats, D: Floats, out: Floats) -> None:
    """Write P = U D U' (5, 5); exactly symmetric."""
    for i in range(N):
        for j in range(i, N):
            total = (1.0 if i == j else U[i, j]) * D[j]
            for k in range(j + 1, N):
                total += U[i, k] * D[k] * U[j, k]
            out[i, j] = total
            out[j, i] = total


@inner_kernel
def _state_of(k: int) -> int:
    """Return the state that measurement k shows."""
    return F if k == 2 else k


@inner_kernel
def _factor(R: Floats) -> None:
    """Overwrite R (3, 3) by L below the diagonal and Dr on it, R = L Dr L'."""
    for j in range(M):
        for k in range(j):
            R[j, j] -= R[j, k] * R[j, k] * R[k, k]
        for i in range(j + 1, M):
            for k in range(j):
                R[i, j] -= R[i, k] * R[j, k] * R[k, k]
            R[i, j] /= R[j, j]


@inner_kernel
def _scalar(U: Floats, D: Floats, h: Floats, r: float, e: float, gain: Floats, dx: Floats) -> None:
    """Take in one scalar h x + noise of variance r; e is what is left of it to explain."""
    alpha = r
    for j in range(N):
        f = h[j]
        for i in range(j):
            f += U[i, j] * h[i]
        b = D[j] * f
        before = alpha
        alpha += f * b
        D[j] *= before / alpha
        lam = -f / before
        for i in range(j):
            old = U[i, j]
            U[i, j] = old + gain[i] * lam
            gain[i] += b * old
        gain[j] = b
    for j in range(N):
        dx[j] += gain[j] * e / alpha
