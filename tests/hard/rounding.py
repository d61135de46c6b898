"""Rounding of the contact laws: model and kernels against 50 digits, in units in the last place.

An error is counted in ulp of the largest term of the sum it comes from: near the rim of a cone, where
H - S d cancels, the ulp of the small result says more of the inputs than of the code.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import mpmath as mp
import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels import geometry
from skinbus.estimate.kernels import law as laws_of_kernels
from skinbus.estimate.kernels.geometry import LinkSurface
from skinbus.estimate.kernels.layout import compile_layout
from skinbus.model import Arm, Cone, Radial, Surface, grid
from tests.inner_kernels import from_python

separation = from_python(geometry.separation)
amplitude, log_force_of = from_python(laws_of_kernels.amplitude), from_python(laws_of_kernels.log_force_of)
pressure = from_python(laws_of_kernels.pressure)

Floats = npt.NDArray[np.float64]

DIGITS: Final = 50
_FRUSTUM: Final = Surface.cone(0.104, 0.056, 0.049)
_D: Final = np.arange(64) * 0.15
RADIAL: Final = Radial(0.75e-3, 5e3 * (1.05 * np.exp(-(_D**2)) - 0.05 * np.exp(-((0.25 * _D) ** 2))), 0.8)


@dataclass(frozen=True, slots=True)
class Rounding:
    """One row of the table: the largest and the median error of a quantity."""

    quantity: str
    largest: float
    median: float
    n: int


def measure_rounding(n: int = 400, seed: int = 1) -> list[Rounding]:
    """Return the errors of laws, inverses and derivatives over n random places, forces and slopes."""
    rng = np.random.default_rng(seed)
    errors: dict[str, list[float]] = {}
    with mp.workdps(DIGITS):
        for _ in range(n):
            _cone(rng, errors)
            _radial(rng, errors)
            _distance(rng, errors)
    return [Rounding(name, max(e), float(np.median(e)), len(e)) for name, e in errors.items()]


def _note(errors: dict[str, list[float]], name: str, got: Any, exact: Any, scale: Any = None) -> None:
    largest = abs(exact) if scale is None else scale
    ulp = float(np.spacing(float(largest))) or 5e-324
    errors.setdefault(name, []).append(float(abs(mp.mpf(float(got)) - exact) / mp.mpf(ulp)))


def _cone(rng: np.random.Generator, errors: dict[str, list[float]]) -> None:
    law = Cone(10.0 ** rng.uniform(-3, 12), float(rng.uniform(0.5, 1.5)))
    log_force = float(rng.uniform(math.log(1e-6), math.log(1e4)))
    force = math.exp(log_force)
    S, e, F = mp.mpf(law.slope), mp.mpf(law.exponent), mp.mpf(force)
    H = mp.cbrt(3 * F**e * S**2 / mp.pi)
    d = float(rng.uniform(0.0, 1.0)) * float(law.reach(force))
    p = H - S * mp.mpf(d)
    _note(errors, "cone: pressure (model)", law.pressure(d, force), max(p, mp.mpf(0)), H)
    if p > 0:
        seen = float(p)
        back = (mp.pi / 3 / S**2 * (mp.mpf(seen) + S * mp.mpf(d)) ** 3) ** (1 / e)
        _note(errors, "cone: force from a pressure (model)", law.force(seen, d), back)
    laws = _columns(law)
    Hk = mp.cbrt(3 * mp.exp(e * mp.mpf(log_force)) * S**2 / mp.pi)
    got, slope = amplitude(laws, 0, log_force)
    _note(errors, "cone: peak (kernel)", got, Hk)
    _note(errors, "cone: d peak / d log F (kernel)", slope, Hk * e / 3)
    back = (3 * mp.log(mp.mpf(got)) + mp.log(mp.pi / 3) - 2 * mp.log(S)) / e
    terms = max(abs(3 * mp.log(mp.mpf(got)) / e), abs(2 * mp.log(S) / e), mp.mpf(1))
    _note(errors, "cone: log F from a peak (kernel)", log_force_of(laws, 0, got), back, terms)


def _radial(rng: np.random.Generator, errors: dict[str, list[float]]) -> None:
    law = RADIAL
    laws, tables = _columns(law), _tables(law)
    force = float(10.0 ** rng.uniform(-6, 4))
    d = float(rng.uniform(0.0, 1.0)) * law.step * (len(law.table) - 1)
    k, slope = _exact_profile(law, mp.mpf(d))
    peak = mp.mpf(float(law.table[0]))
    effective = mp.mpf(force) ** mp.mpf(law.exponent)
    _note(errors, "radial: profile (model)", law.profile(d), k, peak)
    _note(errors, "radial: pressure (model)", law.pressure(d, force), effective * k, effective * peak)
    p, p_d, p_amp = pressure(laws, tables, 0, force, d)
    _note(errors, "radial: pressure (kernel)", p, mp.mpf(force) * k, mp.mpf(force) * peak)
    _note(errors, "radial: d pressure / d distance (kernel)", p_d, mp.mpf(force) * slope,
          mp.mpf(force) * peak / mp.mpf(law.step))  # fmt: skip
    _note(errors, "radial: d pressure / d amplitude (kernel)", p_amp, k, peak)
    if k > 0.01 * peak:  # elsewhere its own rounding decides
        seen = float(effective * k)
        back = (mp.mpf(seen) / k) ** (1 / mp.mpf(law.exponent))
        _note(errors, "radial: force from a pressure (model)", law.force(seen, d), back, back * peak / k)


def _distance(rng: np.random.Generator, errors: dict[str, list[float]]) -> None:
    f = _FRUSTUM
    s1, s2 = (float(v) for v in rng.uniform(0.0, f.length, 2))
    a1, a2 = (float(v) for v in rng.uniform(-0.2, 0.2, 2) * f.period)
    d2, x, y = separation(LinkSurface(f.radius, f.taper, f.period, f.length), s1, a1, s2, a2)
    d = math.sqrt(d2)
    d_s, d_a = x / d, y / d
    t, R = mp.mpf(f.taper), mp.mpf(f.radius)

    def exact(s: Any, a: Any) -> Any:
        r1 = R + t * (s - mp.mpf(f.length) / 2)
        r2 = R + t * (mp.mpf(s2) - mp.mpf(f.length) / 2)
        across = 2 / t * mp.sin(t * (a - mp.mpf(a2)) / (2 * R))
        return mp.sqrt((s - mp.mpf(s2)) ** 2 + r1 * r2 * across**2)

    s, a = mp.mpf(s1), mp.mpf(a1)
    _note(errors, "frustum: distance (kernel)", d, exact(s, a))
    one = mp.mpf(1)
    _note(errors, "frustum: d distance / d s (kernel)", d_s, _derivative(lambda x: exact(x, a), s), one)
    _note(errors, "frustum: d distance / d a (kernel)", d_a, _derivative(lambda x: exact(s, x), a), one)


def _derivative(function: Callable[[Any], Any], x: Any) -> Any:
    """Return a central difference: with a step of 1e-16 its error is 1e-32."""
    h = mp.mpf(10) ** -16
    return (function(x + h) - function(x - h)) / (2 * h)


def _exact_profile(law: Radial, d: Any) -> tuple[Any, Any]:
    """Return k and dk/dd: the cubic whose slopes at the points are central differences, 0 at the first."""
    table = [mp.mpf(float(v)) for v in law.table]
    last = len(table) - 1
    x = d / mp.mpf(law.step)
    i = min(int(mp.floor(x)), last - 1)
    t = x - i

    def slope(j: int) -> Any:
        if j == 0:
            return mp.mpf(0)
        if j == last:
            return table[j] - table[j - 1]
        return (table[j + 1] - table[j - 1]) / 2

    y0, y1, m0, m1 = table[i], table[i + 1], slope(i), slope(i + 1)
    k = y0 * (1 + 2 * t) * (1 - t) ** 2 + y1 * t**2 * (3 - 2 * t)
    k += m0 * t * (1 - t) ** 2 - m1 * t**2 * (1 - t)
    dk = 6 * t * (t - 1) * (y0 - y1) + m0 * (3 * t**2 - 4 * t + 1) + m1 * (3 * t**2 - 2 * t)
    return k, dk / mp.mpf(law.step)


def _columns(law: Cone | Radial) -> Floats:
    return compile_layout(Arm.single_patch(grid(2, 2, 0.01), law=law, size=(0.05, 0.05))).law_par


def _tables(law: Radial) -> Floats:
    return compile_layout(Arm.single_patch(grid(2, 2, 0.01), law=law, size=(0.05, 0.05))).law_table
