"""The noise of tactels: by second differences, and once there is a zero by what is read below it.

Nothing pulls a skin: below its zero all is noise. Above it may be a press that grows slowly, whose squares
would raise the threshold ahead of it; of quick noise, second differences show all.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.workspace import FREE
from skinbus.estimate.kernels.zero_columns import Zeros
from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]

SIGMAS: Final = 6.0
"""Threshold over noise: 400 tactels at 50 Hz give a false touch in 14 hours (at 5: in 3 minutes)."""
CLIP: Final = 3.0
"""What is further from the zero than this many standard deviations counts as that many."""
NOISE_LEAST: Final = 0.1
"""Least noise, share of the declared one: quantised readings may show none at all."""
CLIPPED_VARIANCE: Final = 0.9950
"""Mean of min(z^2, 9) for a standard normal z."""
NOISE_S: Final = 10.0
"""Time constant of the noise estimate, s; sooner after the start it is the mean of all readings."""
FIRST_CYCLES: Final = 20
"""Readings over which the noise of a tactel without a zero is a mean: 0.2 s at the usual rate."""
SECOND_DIFFERENCE: Final = 6.0
"""Variance of p[t] - 2 p[t-1] + p[t-2], in variances of white noise; of a touch that grows evenly it is 0."""


@inner_kernel
def measure_first(w: Zeros, p: int, pressures: Floats) -> None:
    """Estimate the noise of tactels without a zero: a noisy board makes no touches before it has one.

    Nothing pulls a skin, so what a first reading has below zero is noise; second differences follow.
    """
    i0, i1 = w.start[p], w.start[p + 1]
    below, n_below = 0.0, 0
    for i in range(i0, i1):
        away = pressures[i] - w.centre[i]
        if w.healthy[i] and w.n_first[i] == 0 and math.isfinite(away) and away < 0.0:
            below += min(-away, w.most[i]) ** 2
            n_below += 1
    below /= max(n_below, 1)
    together, n = 0.0, 0
    for i in range(i0, i1):
        if w.zeroed[i] or not (w.healthy[i] and math.isfinite(pressures[i])):
            continue
        value = min(max(pressures[i], -w.most[i]), w.most[i])
        is_free = w.touched[i] == FREE
        limit = max(w.touch[i], SIGMAS * math.sqrt(w.variance[i]))
        if w.n_first[i] == 0:
            w.first_variance[i] = max(below, w.declared[i] ** 2)
            w.n_first[i] = 1
        elif is_free and value - w.zero[i] < limit and math.isfinite(w.earlier[i]):
            second = value - 2.0 * w.last[i] + w.earlier[i]
            square = min(second * second / SECOND_DIFFERENCE, CLIP * CLIP * w.variance[i])
            w.n_first[i] = min(w.n_first[i] + 1, FIRST_CYCLES)
            w.first_variance[i] += (square - w.first_variance[i]) / w.n_first[i]
        w.earlier[i] = w.last[i] if is_free else math.nan  # an onset is no noise, nor is a release
        together += w.first_variance[i]
        n += 1
    for i in range(i0, i1):
        if not w.zeroed[i] and n > 0:
            w.variance[i] = max(w.first_variance[i], together / n, w.declared[i] ** 2)


@inner_kernel
def measure_free(w: Zeros, i: int, e: float, dt: float) -> None:
    """Follow the noise of a free tactel that reads e (Pa) above its zero."""
    w.noise_s[i] = min(w.noise_s[i] + dt, NOISE_S)
    gain = dt / (w.noise_s[i] + 0.5 * dt)  # within dt^3 of that of a time constant
    most = CLIP * CLIP * w.variance[i]
    if e < 0.0 and w.low_run[i] < 2:  # several far below it are a zero that has moved
        w.below[i] += gain * (min(e * e, most) / CLIPPED_VARIANCE - w.below[i])
    square = w.second[i] * w.second[i] / SECOND_DIFFERENCE
    if math.isfinite(square):
        w.quick[i] += gain * (min(square, most) / CLIPPED_VARIANCE - w.quick[i])
    w.variance[i] = max(w.below[i], w.quick[i], (NOISE_LEAST * w.declared[i]) ** 2)
