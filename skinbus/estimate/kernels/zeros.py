"""One cycle of the baseline: what is touched, what zeros are out of band, and how zeros are learned.

:mod:`skinbus.estimate.baseline` says by which rules.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.workspace import FREE, HELD, TOUCHED
from skinbus.jit import inner_kernel, kernel

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Touches = npt.NDArray[np.int8]

SIGMAS: Final = 6.0
"""Threshold over noise: 400 tactels at 50 Hz give a false touch in 14 hours (at 5: in 3 minutes)."""
CLIP: Final = 3.0
"""What is further from the zero than this many standard deviations counts as that many."""
EXPLAINED: Final = 3.0
"""Standard deviations of a zero within which drift explains a reading: chance exceeds them once in 370."""
CLIPPED_VARIANCE: Final = 0.9950
"""Mean of min(z^2, 9) for a standard normal z."""
NOISE_S: Final = 10.0
"""Time constant of the noise estimate, s; sooner after the start it is the mean of all readings."""
FIRST_CYCLES: Final = 20
"""Readings over which the noise of a tactel without a zero is a mean: 0.2 s at the usual rate."""
SECOND_DIFFERENCE: Final = 6.0
"""Variance of p[t] - 2 p[t-1] + p[t-2], in variances of white noise; of a touch that grows evenly it is 0."""
LOG_BIAS: Final = 1.12
"""Mean of a variance from ten readings over the exponential of the mean of its logarithm."""
NOISE_LEAST: Final = 0.1
"""Least noise, share of the declared one: quantised readings may show none at all."""
MOVING: Final = 3.0
"""A tactel that varies by more than this many times its noise within a window is not zeroed by it."""
WINDOW_CYCLES: Final = 10
"""Least readings in the mean of a window, and readings in a row that take a tactel out of its band, back into
it, or its zero down: one that is wrong by a bit does not."""
MOST_GAIN: Final = 0.05
"""Share of one reading in a zero, at most: after a minute without observation a zero is less certain than one
reading, but twenty readings are better than one, and 0.4 s later."""
FORGET_S: Final = 10.0
"""A patch that was touched and is not read for so long counts as free, s: else those beside it would never
be followed again. Twice the time after which the master resets a patch that sends no readings."""
COMMON: Final = 2.0
"""The zeros of a board drift together by this much more than they drift apart: they share temperature and
supply."""

OFF, START, REST = 0, 1, 2
"""What the window of a patch is for: nothing, its first zeros, or whether drift explains what is left of a
touch."""


class Zeros(NamedTuple):
    """Columns per tactel (n,) and per patch (p,)."""

    start: Ints  # (p + 1,) first tactel of each patch
    beside_start: Ints  # (p + 1,) where the adjoining patches of each begin in
    beside: Ints
    healthy: Bools  # (n,)
    most: Floats  # (n,) Pa, beyond any count: what is read further from 0 counts as this
    touch: Floats  # (n,) Pa
    ratio: Floats  # (n,) release over touch
    declared: Floats  # (n,) Pa
    band: Floats  # (n,) Pa, half width of the zero band
    drift: Floats  # (n,) Pa^2/s, growth of a zero's variance while it cannot be observed
    centre: Floats  # (n,) Pa, of the zero band
    zero: Floats  # (n,) Pa
    doubt: Floats  # (n,) Pa^2, variance of the zero
    common: Floats  # (p,) Pa^2, variance of what the zeros of a board have in common
    variance: Floats  # (n,) Pa^2, of the noise: the larger of the next two
    below: Floats  # (n,) Pa^2, by readings below the zero
    quick: Floats  # (n,) Pa^2, by second differences
    touched: Touches  # (n,) FREE, TOUCHED or HELD
    zeroed: Bools  # (n,) has a zero from readings
    out: Bools  # (n,) out of the zero band
    run: Ints  # (n,) readings in a row across the border of the band
    low_run: Ints  # (n,) readings in a row below the zero
    low_sum: Floats  # (n,) Pa, of them
    mean: Floats  # (n,) of the window
    n_read: Ints  # (n,) readings of the window
    square: Floats  # (n,) sum of squared deviations of the window
    was_touched: Bools  # (n,) in the window
    last: Floats  # (n,) Pa, as read last
    earlier: Floats  # (n,) Pa, as read before that; NaN while it has no zero and is touched
    second: Floats  # (n,) Pa, second difference of the last three readings of one that has a zero
    n_first: Ints  # (n,) readings of which the noise is a mean, while it has no zero
    first_variance: Floats  # (n,) Pa^2, of the noise, by them
    noise_s: Floats  # (n,) s, time of which the noise is a mean, at most ``NOISE_S``
    seen: Bools  # (n,) read in this cycle
    patch_touched: Bools  # (p,)
    explained: Bools  # (p,) drift explains what the last window has read
    silent_s: Floats  # (p,) since it was read
    own_quiet_s: Floats  # (p,) since the last touch here
    quiet_s: Floats  # (p,) since the last touch here or beside
    window: Ints  # (p,) OFF, START or REST
    window_s: Floats  # (p,)
    window_n: Ints  # (p,)
    pending: Ints  # (p,) tactels that have no zero


@kernel
def follow(
    w: Zeros, pressures: Floats, fresh: Bools, dt: float, tau: float, window_s: float, settle: float
) -> None:
    """Run one cycle: note what is touched, learn where nothing is, take the zeros off."""
    for p in range(len(fresh)):
        w.silent_s[p] = 0.0 if fresh[p] else w.silent_s[p] + dt
        if fresh[p]:
            w.patch_touched[p] = _touch(w, p, pressures)
        elif w.patch_touched[p] and w.silent_s[p] > FORGET_S:
            w.patch_touched[p] = False
            w.own_quiet_s[p] = FORGET_S
            w.touched[w.start[p] : w.start[p + 1]] = FREE
    for p in range(len(fresh)):
        if not fresh[p]:
            _grow(w, p, dt)
            continue
        blocked = w.patch_touched[p]
        for b in range(w.beside_start[p], w.beside_start[p + 1]):
            blocked = blocked or w.patch_touched[w.beside[b]]
        w.quiet_s[p] = 0.0 if blocked else w.quiet_s[p] + dt
        w.own_quiet_s[p] = 0.0 if w.patch_touched[p] else w.own_quiet_s[p] + dt
        if w.own_quiet_s[p] <= settle:  # what is left may be touched in every other cycle
            _window(w, p, REST, dt, settle, window_s)
        elif w.pending[p] > 0 and not blocked:
            _window(w, p, START, dt, settle, window_s)
        else:
            w.window[p] = OFF
        if blocked:
            _grow(w, p, dt)
        elif w.quiet_s[p] > settle:
            _learn(w, p, dt, tau)
    zero = w.zero
    for i in range(len(pressures)):
        pressures[i] -= zero[i]


@inner_kernel
def _touch(w: Zeros, p: int, pressures: Floats) -> bool:
    """Note which tactels of a patch are read, in band and touched; return whether one is touched."""
    any_touched = False
    touched, zero, variance = w.touched, w.zero, w.variance
    if w.pending[p] > 0:
        _first_noise(w, p, pressures)
    for i in range(w.start[p], w.start[p + 1]):
        value = pressures[i]
        w.seen[i] = w.healthy[i] and math.isfinite(value)
        if not w.seen[i]:
            touched[i] = FREE
            continue
        value = min(max(value, -w.most[i]), w.most[i])
        if w.zeroed[i]:
            w.second[i] = value - 2.0 * w.last[i] + w.earlier[i]
            w.earlier[i] = w.last[i]
        w.last[i] = value
        sigma = math.sqrt(variance[i])
        _place_in_band(w, i, value - w.centre[i], CLIP * sigma)
        if w.out[i]:
            w.seen[i] = False
            touched[i] = FREE
            continue
        limit = max(w.touch[i], SIGMAS * sigma)
        before = touched[i] != FREE
        if before:
            limit *= w.ratio[i]
        elif EXPLAINED * EXPLAINED * w.doubt[i] > limit * limit:
            limit = EXPLAINED * math.sqrt(w.doubt[i])
        if value - zero[i] >= limit:
            touched[i] = HELD if before else TOUCHED
            any_touched = True
        else:
            touched[i] = FREE
    return any_touched


@inner_kernel
def _first_noise(w: Zeros, p: int, pressures: Floats) -> None:
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
def _place_in_band(w: Zeros, i: int, away: float, noise: float) -> None:
    """Note whether a tactel is out of its zero band: below it, or its zero has left it and reads so still."""
    if w.out[i]:
        w.run[i] = w.run[i] + 1 if abs(away) <= w.band[i] else 0
    elif away < -w.band[i] - noise:
        w.run[i] += 1
    else:
        w.run[i] = 0
    if w.run[i] >= WINDOW_CYCLES:
        w.out[i] = not w.out[i]
        w.run[i] = 0


@inner_kernel
def _window(w: Zeros, p: int, purpose: int, dt: float, settle: float, window_s: float) -> None:
    """Take the mean of a window (Welford); when its time is over, make zeros of it if that is right."""
    i0, i1 = w.start[p], w.start[p + 1]
    if w.window[p] != purpose:
        w.window[p] = purpose
        w.window_s[p] = 0.0
        w.window_n[p] = 0
        w.explained[p] = False
    if w.window_n[p] == 0:
        for i in range(i0, i1):
            w.mean[i] = w.square[i] = 0.0
            w.n_read[i] = 0
            w.was_touched[i] = False
    w.window_s[p] += dt
    w.window_n[p] += 1
    for i in range(i0, i1):
        if not w.seen[i]:
            continue
        w.was_touched[i] |= w.touched[i] != FREE
        w.n_read[i] += 1
        delta = w.last[i] - w.mean[i]
        w.mean[i] += delta / w.n_read[i]
        w.square[i] += delta * (w.last[i] - w.mean[i])
    if w.window_s[p] < window_s or w.window_n[p] < WINDOW_CYCLES:
        return
    w.window_s[p] = 0.0
    w.window_n[p] = 0
    if purpose == START:
        least = _noise_of_board(w, p)
        for i in range(i0, i1):
            if not w.zeroed[i] and _is_still(w, i) and abs(w.mean[i] - w.centre[i]) <= w.band[i]:
                w.variance[i] = w.below[i] = w.quick[i] = max(_window_variance(w, i), least)
                w.noise_s[i] = window_s
                _set_zero(w, i)
                w.pending[p] -= 1
        return
    w.explained[p] = _is_drift(w, p)
    for b in range(w.beside_start[p], w.beside_start[p + 1]):
        q = w.beside[b]
        if w.own_quiet_s[q] <= settle and not w.explained[q]:
            return
    if w.explained[p]:
        for i in range(i0, i1):
            w.touched[i] = FREE
            if w.zeroed[i] and w.n_read[i] >= WINDOW_CYCLES:
                _set_zero(w, i)
        w.common[p] = 0.0
        w.patch_touched[p] = False
        w.own_quiet_s[p] = math.inf


@inner_kernel
def _window_variance(w: Zeros, i: int) -> float:
    """Return the variance of a tactel in the window."""
    return float(max(w.square[i] / (w.n_read[i] - 1), (NOISE_LEAST * w.declared[i]) ** 2))


@inner_kernel
def _noise_of_board(w: Zeros, p: int) -> float:
    """Return the variance of the usual tactel of a board in the window; that of one may be a third of it."""
    total, n = 0.0, 0
    for i in range(w.start[p], w.start[p + 1]):
        if w.n_read[i] >= WINDOW_CYCLES:
            total += math.log(_window_variance(w, i))
            n += 1
    return LOG_BIAS * math.exp(total / n) if n > 0 else 0.0


@inner_kernel
def _is_still(w: Zeros, i: int) -> bool:
    """Return whether a tactel was read often enough in the window, and varied no more than noise does."""
    n, noise = w.n_read[i], max(w.variance[i], w.declared[i] ** 2)
    return bool(n >= WINDOW_CYCLES and w.square[i] <= (n - 1) * MOVING * MOVING * noise)


@inner_kernel
def _set_zero(w: Zeros, i: int) -> None:
    """Make the mean of the window the zero of a tactel."""
    w.zero[i] = w.mean[i]
    w.doubt[i] = w.variance[i] / w.n_read[i]
    w.zeroed[i] = True
    w.low_run[i] = 0


@inner_kernel
def _is_drift(w: Zeros, p: int) -> bool:
    """Return whether drift explains the means of the window of a patch: together, and each on its own."""
    i0, i1 = w.start[p], w.start[p + 1]
    together, weight, n_observed = 0.0, 0.0, 0
    for i in range(i0, i1):
        if w.n_read[i] >= WINDOW_CYCLES and not w.was_touched[i]:
            known = 1.0 / (w.doubt[i] + w.variance[i] / w.n_read[i])
            together += known * (w.mean[i] - w.zero[i])
            weight += known
    shift = w.common[p] * together / (1.0 + w.common[p] * weight)
    unsure = w.common[p] / (1.0 + w.common[p] * weight)
    for i in range(i0, i1):
        if w.n_read[i] == 0:
            continue
        n_observed += 1
        if not (w.zeroed[i] and _is_still(w, i) and abs(w.mean[i] - w.centre[i]) <= w.band[i]):
            return False
        left = w.mean[i] - w.zero[i] - shift
        if left * left > EXPLAINED * EXPLAINED * (w.doubt[i] + w.variance[i] / w.n_read[i] + unsure):
            return False
    return n_observed > 0


@inner_kernel
def _grow(w: Zeros, p: int, dt: float) -> None:
    """Let the variance of zeros that cannot be observed grow."""
    doubt, drift = w.doubt, w.drift
    i0, i1 = w.start[p], w.start[p + 1]
    for i in range(i0, i1):
        doubt[i] += drift[i] * dt
    w.common[p] += COMMON * COMMON * drift[i0] * dt


@inner_kernel
def _learn(w: Zeros, p: int, dt: float, tau: float) -> None:
    """Follow zero and noise of a patch that is free."""
    if dt == 0.0:
        return
    slowest = min(dt / tau, 1.0)
    any_seen = False
    for i in range(w.start[p], w.start[p + 1]):
        if not w.zeroed[i]:
            continue
        if not w.seen[i]:
            w.doubt[i] += w.drift[i] * dt
            continue
        any_seen = True
        variance, doubt = w.variance[i], w.doubt[i]
        e = w.last[i] - w.zero[i]
        if e < -CLIP * math.sqrt(variance + doubt):
            w.low_run[i] += 1
            w.low_sum[i] = e if w.low_run[i] == 1 else w.low_sum[i] + e
            if w.low_run[i] >= WINDOW_CYCLES:
                # the whole of it, at once; what is left by chance is followed like a new zero
                w.zero[i] = max(w.zero[i] + w.low_sum[i] / w.low_run[i], w.centre[i] - w.band[i])
                w.doubt[i] = variance / w.low_run[i]
                w.low_run[i] = 0
                continue
        else:
            w.low_run[i] = 0
        gain = max(min(doubt / (doubt + variance), MOST_GAIN), slowest)
        most = CLIP * math.sqrt(variance + doubt)
        step = min(max(e, -most), most)
        w.zero[i] += gain * step
        left = (1.0 - gain) * (1.0 - gain) * doubt + gain * gain * variance
        w.doubt[i] = max(left, slowest * variance)
        if abs(w.zero[i] - w.centre[i]) > w.band[i]:
            w.zero[i] = min(max(w.zero[i], w.centre[i] - w.band[i]), w.centre[i] + w.band[i])
            if e * (w.zero[i] - w.centre[i]) > 0.0:
                w.out[i] = True
                w.run[i] = 0
        # Nothing pulls a skin: below its zero all is noise. Above may be a press that grows slowly, whose
        # squares would raise the threshold ahead of it; of quick noise, second differences show all.
        w.noise_s[i] = min(w.noise_s[i] + dt, NOISE_S)
        noise_gain = dt / (w.noise_s[i] + 0.5 * dt)  # within dt^3 of that of a time constant
        most = CLIP * CLIP * variance
        if e < 0.0 and w.low_run[i] < 2:  # several far below it are a zero that has moved
            w.below[i] += noise_gain * (min(e * e, most) / CLIPPED_VARIANCE - w.below[i])
        square = w.second[i] * w.second[i] / SECOND_DIFFERENCE
        if math.isfinite(square):
            w.quick[i] += noise_gain * (min(square, most) / CLIPPED_VARIANCE - w.quick[i])
        w.variance[i] = max(w.below[i], w.quick[i], (NOISE_LEAST * w.declared[i]) ** 2)
    if any_seen:
        w.common[p] = 0.0  # each tactel is observed: there is nothing that only the board as a whole has
    else:
        w.common[p] += COMMON * COMMON * w.drift[w.start[p]] * dt
