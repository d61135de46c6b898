"""The contact laws in kernels, behind one small interface: both are affine in an amplitude.

::

    p(d) = A g(d) + h(d)          cone:   A = H,  g = 1,     h = -S d,  where p > 0, else p = 0
                                  radial: A = f,  g = k(d),  h = 0

with the effective force f = F^e of ``model.law``, so that a fit needs only p, dp/dd, dp/dA and A(F).
A law is a row ``par``: kind, slope (Pa/m), exponent, step (m), points; and a ``table`` (2, points): k and
its slope per step. Kernels that run per tactel take these, not the whole layout: numba counts the
references of every array of a tuple it hands on.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from skinbus.estimate.layout import CONE, Floats

KIND, SLOPE, EXPONENT, STEP, POINTS = range(5)
"""Columns of ``par``."""


@njit(cache=True, nogil=True)
def amplitude(par: Floats, log_force: float) -> tuple[float, float]:
    """Return the amplitude A of a contact of force exp(log_force) N, and dA / d log F."""
    exponent = float(par[EXPONENT])
    effective = math.exp(exponent * log_force)
    if par[KIND] == CONE:
        root = np.cbrt(par[SLOPE])
        height = float(np.cbrt(3.0 * effective / math.pi) * root * root)
        return height, height * exponent / 3.0
    return effective, effective * exponent


@njit(cache=True, nogil=True)
def log_force_of(par: Floats, amplitude: float) -> float:
    """Return log F (F in N) of a contact of this (positive) amplitude: the inverse of :func:`amplitude`."""
    log_effective = math.log(amplitude)
    if par[KIND] == CONE:
        log_effective = 3.0 * log_effective + math.log(math.pi / 3.0) - 2.0 * math.log(par[SLOPE])
    return log_effective / float(par[EXPONENT])


@njit(cache=True, nogil=True)
def reach(par: Floats, amplitude: float) -> float:
    """Return the distance beyond which a contact of this amplitude makes no pressure, m."""
    if par[KIND] == CONE:
        return amplitude / float(par[SLOPE])
    return float(par[STEP] * (par[POINTS] - 1.0))


@njit(cache=True, nogil=True)
def pressure(par: Floats, table: Floats, amplitude: float, d: float) -> tuple[float, float, float]:
    """Return p (Pa) at distance d, dp/dd, dp/dA; for distances within reach."""
    if par[KIND] == CONE:
        return amplitude - par[SLOPE] * d, -par[SLOPE], 1.0
    k, slope = profile(par, table, d)
    return amplitude * k, amplitude * slope, k


@njit(cache=True, nogil=True)
def pressure_beyond(par: Floats, table: Floats, amplitude: float, d: float) -> tuple[float, float, float]:
    """Return p, dp/dd, dp/dA of the law carried on below zero, for distances beyond its reach."""
    if par[KIND] == CONE:
        return amplitude - par[SLOPE] * d, -par[SLOPE], 1.0
    end = par[STEP] * max(par[POINTS] - 1.0, 1.0)
    fall = table[0, 0] / end
    return amplitude * fall * (end - d), -amplitude * fall, fall * (end - d)


@njit(cache=True, nogil=True)
def profile(par: Floats, table: Floats, d: float) -> tuple[float, float]:
    """Return k (1/m^2) of a radial law at distance d, and dk/dd; zeros beyond the table."""
    last = int(par[POINTS]) - 1
    step = par[STEP]
    if not d <= last * step:
        return 0.0, 0.0
    if last == 0:
        return table[0, 0], 0.0
    x = d / step
    i = min(int(x), last - 1)
    t = x - i
    low, m0, m1 = table[0, i], table[1, i], table[1, i + 1]
    rise = table[0, i + 1] - low
    bend = m0 + m1 - 2.0 * rise
    quadratic = rise - m0 - bend
    k = low + t * (m0 + t * (quadratic + t * bend))
    return k, (m0 + t * (2.0 * quadratic + 3.0 * t * bend)) / step


@njit(cache=True, nogil=True)
def peak_pressure(par: Floats, table: Floats, log_force: float) -> float:
    """Return the pressure (Pa) right under a contact."""
    amp, _ = amplitude(par, log_force)
    if par[KIND] == CONE:
        return amp
    return amp * float(table[0, 0])


@njit(cache=True, nogil=True)
def affine(par: Floats, table: Floats, d: float) -> tuple[float, float]:
    """Return g and h of p = A g + h at distance d, for tactels known to be in reach."""
    if par[KIND] == CONE:
        return 1.0, -par[SLOPE] * d
    return profile(par, table, d)[0], 0.0
