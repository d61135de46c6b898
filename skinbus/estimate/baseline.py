"""The zero of every tactel: measured at the start, followed while the tactel is free, held in contact.

Free:     b <- b + g clip(p - b, 3 sd)     g: the gain of a Kalman filter, 1 / 25 at most at 50 Hz
Contact:  b is held, on the touched patch and on those that adjoin it: the skirt of a contact lies below every
          threshold and would be learned away, and the force with it. Its variance grows instead, as that of
          a random walk with the declared drift, and so does the variance of what a board has in common.

A tactel is touched from max(t, 3 standard deviations of its zero) on, t = max(threshold, 6 sigma). It is free
again below t times the declared release over the threshold, and following resumes one second after that.
sigma is its noise, measured while it is free: by readings below its zero, and by second differences above it,
where a press that grows slowly would raise the threshold ahead of itself.

Start: the zero of a tactel is the mean of its first readings, from the first on, while nothing touches its
patch, nor an adjoining one. Touches count from the zero of its calibration until this has lasted for half a
second; a touch before that begins the mean anew. So a patch touched when power comes is not zeroed: its
pressures count from the zero of its calibration until nothing touches it. So a touch at power-on is seen from
the first cycle. The price: a zero that is off by more than the threshold looks like a touch (``suspect`` says
which) until the board is calibrated, the tactel is taken out, or somebody calls :meth:`Baseline.zero`, which
moves the zero band along.

Out of band: nothing pulls a skin, so readings below the zero band are no zero and no pressure, and a zero at
the edge of its band is none. The tactel is ``out``, and no reading of it is used, until it reads within its
band again.

Down: after readings below the zero for half a second, in the band, the zero is as uncertain as they are below
it, and so follows them in another half.

Long touches: what remains on a patch is no touch if drift explains it on every tactel for half a second, here
and on the touched patches beside it: within 3 standard deviations of its zero. It becomes the zero then. So
a light touch that lasts is a zero after the time in which a third of it is drift: 2 kPa after five minutes at
the usual drift, 300 Pa in a minute. A board that drifts further under a touch, all of it together, stays
touched until somebody calls :meth:`Baseline.zero`.

Creep: what has pressed for a second or more leaves up to a tenth of itself in the cover, for seconds. That is
no zero, for it goes again, and it looks like a light touch. So it stays a touch, and ``felt.creep`` says how
much of it may be nothing else.

Failure mode: what grows slower than 3 sigma / tau (20 Pa/s at the usual noise of 200 Pa) is drift, up to the
edge of the zero band. A press between tactels that grows by less than 100 Pa/s where it is strongest may be
drift, too: all of it is below the threshold for so long (200 Pa/s and more never was, in 45 trials).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bools, Floats
from skinbus.estimate.kernels.layout import limit_of
from skinbus.estimate.kernels.workspace import FREE, HELD, TOUCHED
from skinbus.model import Arm
from skinbus.model.validation import check_arm, check_fresh, check_time

Touches = npt.NDArray[np.int8]

ADJOINING = 10e-3
"""Patches whose corners may be this close adjoin, m: the reach of a contact's skirt."""
SETTLE_S = 1.0
"""Time in which a skin settles, s: a press of so long has its full creep, and zeros are followed again so
long after a release. A longer gap between readings counts as this."""
TAU_S = 30.0
"""Time constant of following and of creep, s: long against a touch, short against warming up."""
FORGET_S = 10.0
"""Time constant of the noise estimate, s. A touched patch that is not read for so long counts as free: else
the zeros of those beside it would never be followed again. The master resets such a patch after half of
this."""
CALM_S, CALM_CYCLES = 0.5, 10
"""Time (s) and least number of readings that make a first zero, show that a touch is drift, and that a later
zero is a mean of. So many readings in a row take a tactel out of its band, or back: one bit error does
not."""
SIGMAS = 6.0
"""Threshold over noise: 400 tactels at 50 Hz give a false touch in 14 hours (at 5: in 3 minutes)."""
EXPLAINED = 3.0
"""Standard deviations within which noise and drift explain a reading, and to which it is clipped."""
NOISE_LEAST = 0.1
"""Least noise of a tactel with a zero, share of the declared one: quantised readings may show none at all.
Without a zero it is at least the declared one."""
YOUNG_CYCLES = 50
"""The noise of a free tactel is measured in its first so many readings even while its patch is touched: else
a noisy one would be touched again and again before its noise is known."""
COMMON = 2.0
"""The zeros of a board drift together by this much more than they drift apart: they share temperature and
supply."""
CREEP = 0.05
"""Standard deviation of what a cover still shows of a press that has gone, as a share of the press: soft
silicones creep by 2 to 10 % (doi 10.1089/soro.2015.0002)."""


class Felt(NamedTuple):
    """The state of a baseline, live: columns that only the baseline writes."""

    touched: Touches
    """(n_tactels,) FREE, TOUCHED or HELD, with hysteresis; of missing readings the last state, for a time."""
    zero: Floats
    """(n_tactels,) Pa, what is subtracted."""
    variance: Floats
    """(n_tactels,) Pa^2, of the noise."""
    doubt: Floats
    """(n_tactels,) Pa^2, of the zero."""
    out: Bools
    """(n_tactels,) out of the zero band: what is read there is no pressure."""
    creep: Floats
    """(n_tactels,) Pa, standard deviation of what the cover may still show of what has pressed it."""
    known: Bools
    """(n_tactels,) has had a zero from readings since its board came."""


class KeptZeros(NamedTuple):
    """What a restart must not lose, as copies; columns as those of :class:`Felt`."""

    zero: Floats
    doubt: Floats
    centre: Floats
    """(n_tactels,) Pa, of the zero band."""
    variance: Floats
    zeroed: Bools
    touched: Bools
    pressed: Floats


class Baseline:
    """Subtracts the zeros from the pressures of an arm.

    Columns whose names begin with an underscore are of tactels, (n_tactels,), or of patches, (n_patches,).
    """

    def __init__(self, arm: Arm) -> None:
        check_arm(arm)
        self.arm = arm
        self._last_ns: int | None = None
        n, p = arm.n_tactels, arm.n_patches
        self._patch, self._first = arm.tactel_patch, arm.patch_start[:-1]
        self._near, self._healthy = near_patches(arm, ADJOINING), arm.tactel_healthy
        # beyond any count: what is read further from 0 counts as this
        self._touch, self._most = arm.tactel_threshold, 1.001 * np.abs(limit_of(arm))
        self._ratio = np.clip(arm.tactel_release / np.maximum(self._touch, 1e-9), 0.0, 1.0)
        # a board that declares no noise: no division, no threshold of 0
        self._declared2 = np.maximum(arm.tactel_noise, 1e-3) ** 2
        self._band, self._drift = arm.tactel_zero_band, arm.tactel_zero_drift**2 / 60.0  # in a minute
        self._no_zero = (self._touch / EXPLAINED) ** 2
        self._zeroed = np.zeros(n, np.bool_)  # has a zero from readings
        self._centre, self._pressed, self._level = np.zeros((3, n))
        self._run, self._low_n, self._n_free = np.zeros((3, n), np.int64)
        self._last, self._earlier = np.full((2, n), np.nan)
        self._silent_s, self._calm_n, self._learned_n = np.zeros((3, p))
        self._quiet_s = np.full(p, np.inf)
        self.felt = Felt(
            touched=np.zeros(n, np.int8),
            zero=np.zeros(n),
            variance=self._declared2.copy(),
            # no zero yet: one that is further off than the threshold looks like a touch
            doubt=self._no_zero.copy(),
            out=np.zeros(n, np.bool_),
            creep=np.zeros(n),
            known=np.zeros(n, np.bool_),
        )
        """Its state, without copies: for what runs in the cycle."""

    def apply(self, pressures: Floats, t_ns: int, fresh: npt.ArrayLike | None = None) -> None:
        """Subtract the zeros from pressures in place, and learn from them.

        pressures: (n_tactels,) Pa, calibrated. What is not finite stays so and teaches nothing.
        t_ns:      time of the cycle; one that is not later than the last teaches nothing of time.
        fresh:     (n_patches,) False where readings are missing; None for all there.

        Times end at the nearest cycle: a SYNC that is early by microseconds, as in recordings, prolongs none.
        """
        t_ns = check_time(t_ns)
        if pressures.shape != (self.arm.n_tactels,) or pressures.dtype != np.float64:
            raise ValueError(f"pressures must be float64 of shape ({self.arm.n_tactels},)")
        flags = check_fresh(self.arm, fresh)
        dt = 0.0 if self._last_ns is None else 1e-9 * (t_ns - self._last_ns)
        self._last_ns, dt = t_ns, min(max(dt, 0.0), SETTLE_S)
        seen = flags[self._patch] & self._healthy & np.isfinite(pressures)
        value = np.minimum(np.maximum(np.where(seen, pressures, self._last), -self._most), self._most)
        second = value - 2.0 * self._last + self._earlier
        self._earlier, self._last = np.where(seen, self._last, self._earlier), value
        new = seen & (self._n_free == 0)
        if new.any():
            self._begin(new)
        seen = self._watch_band(seen)
        self._feel(seen, flags, dt)
        learns, waits = self._rest(seen, flags, dt)
        at = seen & learns[self._patch]
        w = self.felt
        free = at | (seen & (w.touched == FREE) & (self._n_free < YOUNG_CYCLES))
        self._n_free += free
        if learns.any():
            self._learned_n += learns
            self._learn(at, dt)
        self._measure_noise(free, second, dt)
        w.doubt[:] += self._drift * dt * ~(at | waits[self._patch])
        w.known[:] |= self._zeroed
        pressures -= w.zero

    def _begin(self, new: Bools) -> None:
        """Take what first readings have below zero for noise: nothing pulls a skin."""
        low = np.where(new, np.clip(self._last - self._centre, -self._band, 0.0), 0.0)
        n_low = np.maximum(np.add.reduceat(low < 0.0, self._first, dtype=int), 1)
        mean2 = np.add.reduceat(low * low, self._first) / n_low
        self.felt.variance[new] = np.maximum(mean2[self._patch], self._declared2)[new]
        self._n_free[new] = 1

    def _watch_band(self, seen: Bools) -> Bools:
        """Note what is out of the zero band; return the tactels read in band."""
        w, away, edge = self.felt, self._last - self._centre, np.abs(self.felt.zero - self._centre)
        leaves = (away < -self._band) | (edge >= self._band)
        crosses = np.where(w.out, np.abs(away) <= self._band, leaves)
        self._run = np.where(seen, np.where(crosses, self._run + 1, 0), self._run)
        turned = self._run >= CALM_CYCLES
        w.out[turned] ^= True
        self._run[turned] = 0
        return seen & ~w.out

    def _feel(self, seen: Bools, fresh: Bools, dt: float) -> None:
        """Note what is touched, and what may creep."""
        w, before = self.felt, self.felt.touched != FREE
        above = self._last - np.where(self._zeroed, w.zero, self._centre)
        limit = self.threshold
        limit = np.where(before, limit * self._ratio, np.maximum(limit, EXPLAINED * np.sqrt(w.doubt)))
        touched = np.where(seen & (above >= limit), np.where(before, HELD, TOUCHED), FREE)
        np.copyto(w.touched, touched, "unsafe", where=fresh[self._patch])
        spoilt: Bools = self._near @ self._on_patch(w.touched != FREE)
        self._learned_n[spoilt] = 0
        again = spoilt[self._patch] & ~self._zeroed
        w.zero[again], w.doubt[again] = self._centre[again], self._no_zero[again]
        now = np.maximum(above, 0.0)
        more = np.where(seen, now - self._pressed, 0.0)
        self._pressed -= np.expm1(-dt / np.where(more > 0.0, SETTLE_S, TAU_S)) * more
        np.copyto(w.creep, CREEP * np.maximum(self._pressed - now, 0.0), where=seen)

    def _rest(self, seen: Bools, fresh: Bools, dt: float) -> tuple[Bools, Bools]:
        """Let touches go that drift explains, or that nobody reads; return who learns, and who waits to."""
        w, patch = self.felt, self._patch
        self._silent_s = np.where(fresh, 0.0, self._silent_s + dt)
        lost, touched = self._silent_s > FORGET_S, self._on_patch(w.touched != FREE)
        self._quiet_s = np.where(touched, 0.0, self._quiet_s + dt * fresh)
        # what is left may be touched in every other cycle
        resting = self._quiet_s + 0.5 * dt <= SETTLE_S
        gain = 1.0 / (1.0 + self._calm_n[patch])
        self._level += np.where(seen, gain * (self._last - self._level), 0.0)
        explained = self._zeroed & (np.abs(self._level - self._centre) <= self._band)
        explained &= (self._level - w.zero) ** 2 <= EXPLAINED**2 * (w.doubt + gain * w.variance)
        calm = resting & self._on_patch(seen) & ~self._on_patch(seen & ~explained)
        self._calm_n = np.where(fresh, (self._calm_n + 1) * calm, self._calm_n * resting)
        restless = resting & (self._calm_n < _cycles(dt))
        released = resting & ~(self._near @ restless)
        new = released[patch] & seen
        w.zero[new], w.doubt[new] = self._level[new], (w.variance * gain)[new]
        over = released | lost
        w.touched[over[patch]] = FREE
        self._quiet_s[over] = np.inf
        free = fresh & ~(self._near @ (self._quiet_s <= 0.0))
        learns = free & (dt > 0.0) & ~(self._near @ (resting & ~over))
        return learns, free & ~learns

    def _learn(self, at: Bools, dt: float) -> None:
        """Follow the zeros of free tactels."""
        w, e = self.felt, self._last - self.felt.zero
        # what a cover still shows of a press, or springs below, is noise that lasts
        noise2 = w.variance + w.creep**2
        most = EXPLAINED * np.sqrt(noise2 + w.doubt)
        low = at & (e < -most)
        self._low_n = np.where(at, (self._low_n + 1) * low, self._low_n)
        falls = self._low_n >= _cycles(dt)
        # so the next reading is no longer too low, and it is followed
        w.doubt[falls] = e[falls] ** 2
        at = at & ~low
        gain = np.minimum(
            w.doubt / (w.doubt + noise2), 1.0 / np.minimum(np.maximum(self._n_free, 1), _cycles(dt))
        )
        zero = w.zero + gain * np.minimum(e, most)
        doubt = np.maximum((1.0 - gain) ** 2 * w.doubt + gain**2 * noise2, dt / TAU_S * noise2)
        np.copyto(w.zero, np.clip(zero, self._centre - self._band, self._centre + self._band), where=at)
        np.copyto(w.doubt, doubt, where=at)
        self._zeroed |= at & (self._learned_n[self._patch] >= _cycles(dt))

    def _measure_noise(self, free: Bools, second: Floats, dt: float) -> None:
        """Follow the noise of free tactels by ``second`` (Pa) differences, and by what is below a zero.

        Below its zero all is noise. Above may be a press that grows slowly, whose squares would raise the
        threshold ahead of it; of white noise the second difference has six times the variance.
        """
        w, e = self.felt, self._last - self.felt.zero
        total = w.variance + w.doubt
        is_below = (e < 0.0) & (e * e <= EXPLAINED**2 * total)
        sample = np.where(is_below, e * e * w.variance / total, second**2 / 6.0)
        sample = np.minimum(sample, EXPLAINED**2 * w.variance)
        gain = np.maximum(1.0 / np.maximum(self._n_free, 1), dt / (FORGET_S + dt))
        variance = np.maximum(w.variance + gain * (sample - w.variance), NOISE_LEAST**2 * self._declared2)
        np.copyto(w.variance, variance, where=free & np.isfinite(second))

    def _on_patch(self, flags: Bools) -> Bools:
        """Return whether any tactel of a patch has a flag, (n_patches,)."""
        return np.logical_or.reduceat(flags, self._first)

    def zero(self, patch: int | None = None) -> None:
        """Let the next start take what it reads as zero, touched or not, on one patch or all.

        The zero band moves along: whoever asks for it says that nothing touches the skin. A patch that is
        not read now begins as at power-on: its newest readings may be of a touch.
        """
        w, p = self.felt, slice(None) if patch is None else slice(patch, patch + 1)
        i = slice(None) if patch is None else self.arm.tactels_of(patch)
        read = np.isfinite(self._last[i]) & (self._silent_s <= CALM_S)[self._patch[i]]
        w.zero[i] = self._centre[i] = np.where(read, self._last[i], self._centre[i])
        w.doubt[i] = np.maximum(w.variance[i], w.doubt[i])
        self._n_free[i] = read
        for column in (self._zeroed, w.out, self._pressed, w.creep, self._low_n, self._run, w.touched):
            column[i] = 0
        self._quiet_s[p], self._learned_n[p] = np.inf, 0

    def begin(self, patch: int) -> None:
        """Begin a patch as at power-on: another board is in its place."""
        w, i = self.felt, self.arm.tactels_of(patch)
        self._last[i], self._centre[i], w.known[i] = np.nan, 0.0, False
        w.variance[i], w.doubt[i] = self._declared2[i], self._no_zero[i]
        self.zero(patch)

    def kept(self) -> KeptZeros:
        """Return what a restart must not lose."""
        w = self.felt
        kept = KeptZeros(w.zero, w.doubt, self._centre, w.variance, self._zeroed, self.touched, self._pressed)
        return KeptZeros._make(column.copy() for column in kept)

    def resume(self, patch: int, kept: KeptZeros, age_s: float) -> int:
        """Take up the zeros of one patch, ``age_s`` old; return of how many tactels.

        kept: of this patch alone.

        Their variances have grown with the declared drift. A tactel without a zero begins as at power-on, and
        so does one whose zero may have drifted on its own by its threshold since. What the board has drifted
        in common its free tactels show.
        """
        w, here = self.felt, self.arm.tactels_of(patch)
        grown = self._drift[here] * age_s
        taken = kept.zeroed & self._healthy[here] & (EXPLAINED**2 * grown <= self._touch[here] ** 2)
        i, own = np.arange(here.start, here.stop)[taken], KeptZeros(*(column[taken] for column in kept))
        w.zero[i], self._centre[i] = np.clip((own.zero, own.centre), -self._most[i], self._most[i])
        w.doubt[i] = own.doubt + grown[taken]
        w.variance[i] = own.variance
        w.touched[i] = np.where(own.touched, HELD, FREE)
        self._zeroed[i], self._n_free[i] = True, 10**6
        self._pressed[here] = kept.pressed * math.exp(-age_s / TAU_S)
        if own.touched.any():
            self._quiet_s[patch] = 0.0
        return len(i)

    @property
    def common(self) -> Floats:
        """(n_patches,) Pa^2, of what the zeros of a board have in common: the surest one may have drifted."""
        doubt = np.where(self._zeroed | ~self._healthy, self.felt.doubt, 0.0)
        return COMMON**2 * np.minimum.reduceat(doubt, self._first)

    @property
    def zeros(self) -> Floats:
        """(n_tactels,) Pa, what is subtracted."""
        return self.felt.zero.copy()

    @property
    def noise(self) -> Floats:
        """(n_tactels,) Pa, standard deviation measured while free."""
        return np.sqrt(self.felt.variance)

    @property
    def threshold(self) -> Floats:
        """(n_tactels,) Pa, from which on a tactel is touched."""
        return np.maximum(self._touch, SIGMAS * self.noise)

    @property
    def touched(self) -> Bools:
        """(n_tactels,) touched, with hysteresis."""
        return np.asarray(self.felt.touched != FREE)

    @property
    def suspect(self) -> Bools:
        """(n_tactels,) touched ever since power came: a touch at power-on, or a zero that is far off."""
        return self.touched & ~self._zeroed


def _cycles(dt: float) -> float:
    """Return the cycles of dt (s) after which ``CALM_S`` is over, at least ``CALM_CYCLES``."""
    return max(CALM_CYCLES, CALM_S / max(dt, 1e-9) - 0.5)


def near_patches(arm: Arm, gap: float) -> Bools:
    """Return which patches are one, or have corners that may be within a gap, m, (n_patches, n_patches)."""
    half = np.array([0.5 * math.hypot(*placed.patch.size) for placed in arm.patches])
    near = np.zeros((arm.n_patches, arm.n_patches), np.bool_)
    for k, link in enumerate(arm.links):
        p = np.flatnonzero(arm.patch_link == k)
        s, a = arm.patch_s[p], arm.patch_a[p]
        d = link.surface.distance(s[:, None], a[:, None], s, a)
        near[np.ix_(p, p)] = d <= half[p, None] + half[p] + gap
    return near
