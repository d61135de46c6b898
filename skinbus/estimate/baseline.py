"""The zero of every tactel: found at the start, followed while the tactel is free, frozen in contact.

Free:     b <- b + dt / min(t, tau) clip(p - b, 3 sigma)        t: time it has been followed
Contact:  b stays, on the touched patch and on those that adjoin it: the skirt of a contact lies under every
          threshold and would be learned away, and the force with it.

A tactel is touched from max(threshold, 6 sigma) on and free again below the same share of that as the release
is of the threshold; sigma is its noise, measured while it is free. Following resumes one second after the
release.

Start: the mean of half a second becomes the zero of a patch if in that time none of its tactels, nor one of
an adjoining patch, was touched. A patch touched when power comes is not zeroed: its pressures count from
the zero of its calibration, and the half second begins anew until nothing touches it. So a touch at
power-on is seen from the first cycle. The price: a zero that is off by more than the threshold looks like a
touch (``suspect`` says which) until the board is calibrated, the tactel is taken out, or somebody who knows
calls :meth:`Baseline.zero`. A negative zero cannot be a touch and is taken.

Failure mode: what grows slower than 3 sigma / tau (20 Pa/s at the usual noise of 200 Pa) is drift.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.layout import limit_of, step_of
from skinbus.estimate.kernels.workspace import FREE, HELD, TOUCHED
from skinbus.estimate.validation import check_arm, check_time
from skinbus.jit import CompileWatch, kernel
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Touches = npt.NDArray[np.int8]

SIGMAS: Final = 6.0
"""Threshold over noise: 400 tactels at 50 Hz give a false touch in 14 hours (at 5: in 3 minutes)."""
CLIP: Final = 3.0
"""What is further from the zero than this many sigmas counts as that many."""
CLIPPED_VARIANCE: Final = 0.9950
"""Mean of min(z^2, 9) for a standard normal z."""
NOISE_S: Final = 10.0
"""Time constant of the noise estimate, s."""
NOISE_LEAST: Final = 0.1
"""Least noise, share of the declared one: quantised readings may show none at all."""
MOVING: Final = 3.0
"""A tactel that varies by more than this many declared sigmas at the start is not zeroed then."""
START_CYCLES: Final = 10
"""Least readings in the mean of a start."""
STEP_MOST_S: Final = 1.0
"""A longer gap counts as this: nothing is learned from time in which nothing was read."""
FORGET_S: Final = 10.0
"""A patch that was touched and is not read for so long counts as free, s: else those beside it would never
be followed again. Twice the time after which the master resets a patch that sends no readings."""
ADJOINING: Final = 10e-3
"""Patches whose corners may be this close adjoin, m: the reach of a contact's skirt."""


class BaselineWork(NamedTuple):
    """Columns per tactel (n,) and per patch (p,)."""

    start: Ints  # (p + 1,) first tactel of each patch
    beside_start: Ints  # (p + 1,) where the adjoining patches of each begin in
    beside: Ints
    healthy: Bools  # (n,)
    most: Floats  # (n,) Pa, beyond any count: what is read further from 0 counts as this
    touch: Floats  # (n,) Pa
    ratio: Floats  # (n,) release over touch
    declared: Floats  # (n,) Pa
    zero: Floats  # (n,) Pa
    variance: Floats  # (n,) Pa^2
    touched: Touches  # (n,) FREE, TOUCHED or HELD
    mean: Floats  # (n,) of the start
    n_read: Ints  # (n,) readings of the start
    square: Floats  # (n,) sum of squared deviations of the start
    last: Floats  # (n,) Pa, as read last
    still_s: Floats  # (n,) s
    seen: Bools  # (n,) read in this cycle
    patch_touched: Bools  # (p,)
    silent_s: Floats  # (p,) since it was read
    quiet_s: Floats  # (p,) since the last touch here or beside
    start_s: Floats  # (p,) of the start so far, -1 when it is over
    start_n: Ints  # (p,)
    age_s: Floats  # (p,) time followed


class Felt(NamedTuple):
    """What a baseline knows of each tactel now, live: columns (n_tactels,) that only the baseline writes."""

    touched: Touches
    """FREE, TOUCHED or HELD, with hysteresis; of readings that are missing what the last was, for a time."""
    zero: Floats
    """Pa, what is taken off."""
    variance: Floats
    """Pa^2, of the noise."""


class Baseline:
    """Takes the zero off the pressures of an arm.

    ``tau_s``     time constant of following, s: long against a touch, short against warming up
    ``start_s``   time of which the mean is the first zero, s
    ``settle_s``  time from release to following again, s
    ``on_compile``  called once if the kernels have to be compiled first
    """

    def __init__(
        self,
        arm: Arm,
        *,
        tau_s: float = 30.0,
        start_s: float = 0.5,
        settle_s: float = 1.0,
        on_compile: Callable[[], None] | None = None,
    ) -> None:
        check_arm(arm)
        if not (tau_s > 0.0 and start_s > 0.0 and settle_s >= 0.0):
            raise ValueError(
                f"wanted tau_s > 0, start_s > 0, settle_s >= 0; got {tau_s}, {start_s}, {settle_s}"
            )
        self.arm = arm
        self._times = (tau_s, start_s, settle_s)
        self._work = _make_work(arm)
        self._all = np.ones(arm.n_patches, np.bool_)
        self._last_ns: int | None = None
        with CompileWatch(on_compile):
            follow(self._work, np.full(arm.n_tactels, np.nan), self._all, 0.0, *self._times)
        self._work = _make_work(arm)  # what the first call compiled, it also counted
        w = self._work
        self.felt = Felt(w.touched, w.zero, w.variance)
        """What it knows, without copies: for those who work in the cycle."""

    def apply(self, pressures: Floats, t_ns: int, fresh: npt.ArrayLike | None = None) -> None:
        """Take the zeros off pressures in place, and learn from them.

        pressures: (n_tactels,) Pa, calibrated. What is not finite stays so and teaches nothing.
        t_ns:      time of the cycle; one that is not later than the last teaches nothing of time.
        fresh:     (n_patches,) False where readings are missing; None for all there.
        """
        t_ns = check_time(t_ns)
        if pressures.shape != (self.arm.n_tactels,) or pressures.dtype != np.float64:
            raise ValueError(f"pressures must be float64 of shape ({self.arm.n_tactels},)")
        flags = self._all if fresh is None else np.ascontiguousarray(fresh, np.bool_)
        if flags.shape != self._all.shape:
            raise ValueError(f"fresh must have shape {self._all.shape}, got {flags.shape}")
        dt = 0.0 if self._last_ns is None else 1e-9 * (t_ns - self._last_ns)
        self._last_ns = t_ns
        # in an array of one kind: kernels are compiled for no other
        own = pressures if pressures.flags.carray else pressures.copy()
        follow(self._work, own, flags, min(max(dt, 0.0), STEP_MOST_S), *self._times)
        if own is not pressures:
            pressures[:] = own

    def zero(self, patch: int | None = None) -> None:
        """Let the next start take what it reads as zero, touched or not, on one patch or all."""
        w = self._work
        patches = range(self.arm.n_patches) if patch is None else [patch]
        for p in patches:
            i = slice(w.start[p], w.start[p + 1])
            read = np.isfinite(w.last[i])
            w.zero[i][read] = w.last[i][read]
            w.touched[i] = FREE
            w.patch_touched[p] = False
            w.start_s[p], w.start_n[p], w.age_s[p] = 0.0, 0, 0.0

    @property
    def zeros(self) -> Floats:
        """(n_tactels,) Pa, what is taken off."""
        return self._work.zero.copy()

    @property
    def noise(self) -> Floats:
        """(n_tactels,) Pa, standard deviation measured while free."""
        return np.sqrt(self._work.variance)

    @property
    def threshold(self) -> Floats:
        """(n_tactels,) Pa, from which on a tactel is touched."""
        return np.maximum(self._work.touch, SIGMAS * self.noise)

    @property
    def touched(self) -> Bools:
        """(n_tactels,) touched, with hysteresis."""
        return np.asarray(self._work.touched != FREE)

    @property
    def suspect(self) -> Bools:
        """(n_tactels,) touched ever since power came: a touch at power-on, or a zero that is far off."""
        starting = self._work.start_s >= 0.0
        return np.asarray(self.touched & starting[self.arm.tactel_patch])

    @property
    def still_s(self) -> Floats:
        """(n_tactels,) s since the reading last changed by a bit: long where others rustle is stuck."""
        return self._work.still_s.copy()


@kernel
def follow(
    w: BaselineWork,
    pressures: Floats,
    fresh: Bools,
    dt: float,
    tau: float,
    start_s: float,
    settle: float,
) -> None:
    """Run one cycle: note what is touched, learn where nothing is, take the zeros off."""
    for p in range(len(fresh)):
        w.silent_s[p] = 0.0 if fresh[p] else w.silent_s[p] + dt
        if fresh[p]:
            w.patch_touched[p] = _touch(w, p, pressures, dt)
        elif w.patch_touched[p] and w.silent_s[p] > FORGET_S:
            w.patch_touched[p] = False
            w.touched[w.start[p] : w.start[p + 1]] = FREE
    for p in range(len(fresh)):
        if not fresh[p]:
            continue
        blocked = w.patch_touched[p]
        for q in w.beside[w.beside_start[p] : w.beside_start[p + 1]]:
            blocked = blocked or w.patch_touched[q]
        w.quiet_s[p] = 0.0 if blocked else w.quiet_s[p] + dt
        if w.start_s[p] >= 0.0:
            _start(w, p, blocked, dt, start_s)
        elif w.quiet_s[p] > settle:
            w.age_s[p] += dt
            _learn(w, p, dt, tau)
    zero = w.zero
    for i in range(len(pressures)):
        pressures[i] -= zero[i]


@kernel
def _touch(w: BaselineWork, p: int, pressures: Floats, dt: float) -> bool:
    """Note which tactels of a patch are read and touched; return whether one is."""
    any_touched = False
    for i in range(w.start[p], w.start[p + 1]):
        value = pressures[i]
        w.seen[i] = w.healthy[i] and math.isfinite(value)
        if not w.seen[i]:
            w.touched[i] = FREE
            continue
        value = min(max(value, -w.most[i]), w.most[i])
        w.still_s[i] = w.still_s[i] + dt if value == w.last[i] else 0.0
        w.last[i] = value
        limit = max(w.touch[i], SIGMAS * math.sqrt(w.variance[i]))
        before = w.touched[i] != FREE
        if before:
            limit *= w.ratio[i]
        if value - w.zero[i] >= limit:
            w.touched[i] = HELD if before else TOUCHED
            any_touched = True
        else:
            w.touched[i] = FREE
    return any_touched


@kernel
def _start(w: BaselineWork, p: int, blocked: bool, dt: float, start_s: float) -> None:
    """Gather the mean of a start (Welford); it is the zero when the time is over and nothing was touched."""
    if blocked:
        w.start_s[p] = 0.0
        w.start_n[p] = 0
        return
    if w.start_n[p] == 0:
        for i in range(w.start[p], w.start[p + 1]):
            w.mean[i] = w.square[i] = 0.0
            w.n_read[i] = 0
    w.start_s[p] += dt
    w.start_n[p] += 1
    for i in range(w.start[p], w.start[p + 1]):
        if not w.seen[i]:
            continue
        w.n_read[i] += 1
        delta = w.last[i] - w.mean[i]
        w.mean[i] += delta / w.n_read[i]
        w.square[i] += delta * (w.last[i] - w.mean[i])
    if w.start_s[p] < start_s or w.start_n[p] < START_CYCLES:
        return
    for i in range(w.start[p], w.start[p + 1]):
        if w.n_read[i] < START_CYCLES:
            continue
        variance = w.square[i] / (w.n_read[i] - 1)
        if variance <= (MOVING * w.declared[i]) ** 2:
            w.zero[i] = w.mean[i]
            w.variance[i] = max(variance, (NOISE_LEAST * w.declared[i]) ** 2)
    w.age_s[p] = w.start_s[p]
    w.start_s[p] = -1.0


@kernel
def _learn(w: BaselineWork, p: int, dt: float, tau: float) -> None:
    """Follow zero and noise of a patch that is free."""
    gain = dt / min(max(w.age_s[p], dt), tau) if dt > 0.0 else 0.0
    noise_gain = 1.0 - math.exp(-dt / NOISE_S)
    for i in range(w.start[p], w.start[p + 1]):
        if not w.seen[i]:
            continue
        e = w.last[i] - w.zero[i]
        most = CLIP * math.sqrt(w.variance[i])
        e = min(max(e, -most), most)
        w.zero[i] += gain * e
        least = (NOISE_LEAST * w.declared[i]) ** 2
        v = w.variance[i] + noise_gain * (e * e / CLIPPED_VARIANCE - w.variance[i])
        w.variance[i] = max(v, least)


def _make_work(arm: Arm) -> BaselineWork:
    """Return the columns of an arm at the start of a start."""
    n, p = arm.n_tactels, arm.n_patches
    beside = [_beside(arm, k) for k in range(p)]
    declared = np.maximum(
        arm.tactel_noise, 1e-3
    )  # a board that declares none: no division, no threshold of 0
    return BaselineWork(
        start=arm.patch_start.astype(np.int64),
        beside_start=np.concatenate([[0], np.cumsum([len(b) for b in beside])]).astype(np.int64),
        beside=np.concatenate(beside).astype(np.int64),
        healthy=np.array(arm.tactel_healthy),
        most=np.maximum(limit_of(arm), 0.0) + 2.0 * (1.0 + np.abs(arm.tactel_offset)) * step_of(arm),
        touch=np.array(arm.tactel_threshold),
        ratio=np.clip(arm.tactel_release / np.maximum(arm.tactel_threshold, 1e-9), 0.0, 1.0),
        declared=declared,
        zero=np.zeros(n),
        variance=declared**2,
        touched=np.zeros(n, np.int8),
        mean=np.zeros(n),
        n_read=np.zeros(n, np.int64),
        square=np.zeros(n),
        last=np.full(n, np.nan),
        still_s=np.zeros(n),
        seen=np.zeros(n, np.bool_),
        patch_touched=np.zeros(p, np.bool_),
        silent_s=np.zeros(p),
        quiet_s=np.zeros(p),
        start_s=np.zeros(p),
        start_n=np.zeros(p, np.int64),
        age_s=np.zeros(p),
    )


def _beside(arm: Arm, p: int) -> Ints:
    """Return the patches of the same link whose corners may come close to those of patch p."""
    link = int(arm.patch_link[p])
    half = np.array([0.5 * math.hypot(*placed.patch.size) for placed in arm.patches])
    d = arm.links[link].surface.distance(arm.patch_s[p], arm.patch_a[p], arm.patch_s, arm.patch_a)
    near = (arm.patch_link == link) & (d <= half + half[p] + ADJOINING)
    near[p] = False
    return np.flatnonzero(near)
