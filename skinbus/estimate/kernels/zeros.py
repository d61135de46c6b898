"""One cycle of the baseline: what is touched, what zeros are out of band, and how zeros are learned.

:mod:`skinbus.estimate.baseline` says by which rules.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.workspace import FREE, HELD, TOUCHED
from skinbus.estimate.kernels.zero_columns import Zeros
from skinbus.estimate.kernels.zero_noise import CLIP, NOISE_LEAST, SIGMAS, measure_first, measure_free
from skinbus.jit import inner_kernel, kernel

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

EXPLAINED: Final = 3.0
"""Standard deviations of a zero within which drift explains a reading: chance exceeds them once in 370."""
LOG_BIAS: Final = 1.12
"""Mean of a variance from ten readings over the exponential of the mean of its logarithm."""
MOVING: Final = 3.0
"""A tactel that varies by more than this many times its noise within a window is not zeroed by it."""
WINDOW_CYCLES: Final = 10
"""Least readings in the mean of a window, and readings in a row that take a tactel out of its band, back into
it, or its zero down: one that is wrong by a bit does not."""
LOW_S: Final = 0.5
"""Time below its zero that takes it down, s: as long as the first zero takes."""
LOW_MOST: Final = 3.0
"""Standard deviation of a zero that has gone down, at most, in touch thresholds: three of it hide a touch
until following has halved it a few times, within two seconds."""
MOST_GAIN: Final = 0.05
"""Share of one reading in a zero, at most: after a minute without observation a zero is less certain than one
reading, but twenty readings are better than one, and 0.4 s later."""
GAIN_S: Final = 0.4
"""... and at high rates in this time: what fell below its zero may come back for as long."""
FORGET_S: Final = 10.0
"""A patch that was touched and is not read for so long counts as free, s: else those beside it would never
be followed again. Twice the time after which the master resets a patch that sends no readings."""
COMMON: Final = 2.0
"""The zeros of a board drift together by this much more than they drift apart: they share temperature and
supply."""
CREEP: Final = 0.05
"""Standard deviation of what a cover still shows of a press that has gone, of the press: soft silicones creep
by 2 to 10 % (doi 10.1089/soro.2015.0002)."""
CREEP_FULL_SCALE: Final = 4.0
"""What presses at full scale may be so much more: as far as places of contacts beside a tactel are tried."""
CREEP_RISE_S: Final = 1.0
"""What creeps at once is there after a press of so long, s; ..."""
CREEP_FALL_S: Final = 20.0
"""... and what creeps slowly goes in so long, s."""

OFF, START, REST = 0, 1, 2
"""What the window of a patch is for: nothing, its first zeros, or whether drift explains what is left of a
touch."""


@kernel
def follow(
    w: Zeros, pressures: Floats, fresh: Bools, dt: float, tau: float, window_s: float, settle: float
) -> None:
    """Run one cycle: note what is touched, learn where nothing is, take the zeros off.

    Times end at the nearest cycle: a SYNC that is early by microseconds, as in a recording, prolongs none.
    """
    rise, fall = -math.expm1(-dt / CREEP_RISE_S), -math.expm1(-dt / CREEP_FALL_S)
    for p in range(len(fresh)):
        w.silent_s[p] = 0.0 if fresh[p] else w.silent_s[p] + dt
        if fresh[p]:
            w.patch_touched[p] = _touch(w, p, pressures)
            _creep(w, p, rise, fall)
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
        if w.own_quiet_s[p] + 0.5 * dt <= settle:  # what is left may be touched in every other cycle
            _window(w, p, REST, dt, settle, window_s)
        elif w.pending[p] > 0 and not blocked:
            _window(w, p, START, dt, settle, window_s)
        else:
            w.window[p] = OFF
        if blocked:
            _grow(w, p, dt)
        elif w.quiet_s[p] + 0.5 * dt > settle:
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
        measure_first(w, p, pressures)
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
def _creep(w: Zeros, p: int, rise: float, fall: float) -> None:
    """Follow what presses a patch, and what its cover may still show of what has pressed."""
    pressed, last, zero, seen = w.pressed, w.last, w.zero, w.seen
    for i in range(w.start[p], w.start[p + 1]):
        if not seen[i]:
            continue
        now = max(last[i] - zero[i], 0.0)
        if last[i] >= w.full[i]:
            now *= CREEP_FULL_SCALE
        more = now - pressed[i]
        pressed[i] += (rise if more > 0.0 else fall) * more
        w.creep[i] = CREEP * max(pressed[i] - now, 0.0)


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
    if w.window_s[p] + 0.5 * dt < window_s or w.window_n[p] < WINDOW_CYCLES:
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
        if w.own_quiet_s[q] + 0.5 * dt <= settle and not w.explained[q]:
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
        # what a cover still shows of a press, or springs below, is noise that lasts
        variance, doubt = w.variance[i] + w.creep[i] * w.creep[i], w.doubt[i]
        e = w.last[i] - w.zero[i]
        if e < -CLIP * math.sqrt(variance + doubt):
            w.low_run[i] += 1
            w.low_sum[i] = e if w.low_run[i] == 1 else w.low_sum[i] + e
            w.low_s[i] = dt if w.low_run[i] == 1 else w.low_s[i] + dt
            if w.low_run[i] >= WINDOW_CYCLES and w.low_s[i] + 0.5 * dt >= LOW_S:
                # the whole of it, at once; it may as well come back
                mean = w.low_sum[i] / w.low_run[i]
                w.zero[i] = max(w.zero[i] + mean, w.centre[i] - w.band[i])
                w.doubt[i] = min(mean * mean, (LOW_MOST * w.touch[i]) ** 2)
                w.low_run[i] = 0
            continue
        w.low_run[i] = 0
        gain = max(min(doubt / (doubt + variance), MOST_GAIN, dt / GAIN_S), slowest)
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
        measure_free(w, i, e, dt)
    if any_seen:
        w.common[p] = 0.0  # each tactel is observed: there is nothing that only the board as a whole has
    else:
        w.common[p] += COMMON * COMMON * w.drift[w.start[p]] * dt
