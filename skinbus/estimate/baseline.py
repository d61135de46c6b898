"""The zero of every tactel: measured at the start, followed while the tactel is free, held in contact.

Free:     b <- b + g clip(p - b, 3 sd)     g: the gain of a Kalman filter, dt / tau at least, 1 / 20 at most
Contact:  b is held, on the touched patch and on those that adjoin it: the skirt of a contact lies below every
          threshold and would be learned away, and the force with it. Its variance grows instead, as that of
          a random walk with the declared drift, and so does the variance of what a board has in common.

A tactel is touched from max(threshold, 6 sigma, 3 standard deviations of its zero) on and free again below
the release, the same share of the first two as of the threshold; sigma is its noise, measured while it is
free: below its zero by the distance from it, above by second differences, or a press that grows slowly would
raise the threshold ahead of itself. Following resumes one second after the release.

Start: the mean of half a second becomes the zero of a tactel if in that time nothing touched its patch, nor
an adjoining one, and if it lies in the zero band. A patch touched when power comes is not zeroed: its
pressures count from the zero of its calibration, and the half second begins anew until nothing touches it. So
a touch at power-on is seen from the first cycle. The price: a zero that is off by more than the threshold
looks like a touch (``suspect`` says which) until the board is calibrated, the tactel is taken out, or
somebody calls :meth:`Baseline.zero`, which moves the zero band along.

Out of band: nothing pulls a skin, so readings below the zero band are no zero and no pressure. The tactel is
``out``, and no reading of it is used, until it reads within its band again.

Down: readings below the zero for half a second become the zero at once, if they are in the band. They may
come back: the zero is as uncertain as it has moved, up to three thresholds.

Long touches: what remains on a patch is no touch if drift explains it on every tactel for half a second, here
and on the touched patches beside it: within 3 standard deviations of zeros that have moved on their own, and
together. It becomes the zero then. So a light touch that lasts is a zero after the time in which a third of
it is drift: 2 kPa after five minutes at the usual drift, 300 Pa in a minute.

Creep: what has pressed for a second or more leaves up to a tenth of itself in the cover, for seconds. That is
no zero, above or below, it goes again, and a light touch looks the same: it stays a touch, and ``felt.creep``
says of how much of it that may be all.

Failure mode: what grows slower than 3 sigma / tau (20 Pa/s at the usual noise of 200 Pa) is drift, up to the
edge of the zero band. A press between tactels that grows by less than 100 Pa/s where it is strongest may be:
all of it is below the threshold for so long (200 Pa/s and more never was, in 45 trials).
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.layout import limit_of, step_of
from skinbus.estimate.kernels.workspace import FREE, HELD, TOUCHED
from skinbus.estimate.validation import check_arm, check_time
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Touches = npt.NDArray[np.int8]

STEP_MOST_S: Final = 1.0
"""A longer gap counts as this: nothing is learned from time in which nothing was read."""
ADJOINING: Final = 10e-3
"""Patches whose corners may be this close adjoin, m: the reach of a contact's skirt."""
DRIFT_S: Final = 60.0
"""The declared drift is the standard deviation of the change of a zero in this time, s."""
FORGET_S: Final = 10.0
"""A patch that was touched and is not read for so long counts as free, s: else those beside it would never
be followed again. Twice the time after which the master resets a patch that sends no readings."""

# --- Noise -----------------------------------------------------------------------------------------
SIGMAS: Final = 6.0
"""Threshold over noise: 400 tactels at 50 Hz give a false touch in 14 hours (at 5: in 3 minutes)."""
CLIP: Final = 3.0
"""What is further from the zero than this many standard deviations counts as that many."""
CLIPPED_VARIANCE: Final = 0.9950
"""Mean of min(z^2, 9) for a standard normal z."""
NOISE_LEAST: Final = 0.1
"""Least noise of a tactel with a zero, share of the declared one: quantised readings may show none at all.
Without a zero it is at least the declared one."""
NOISE_S: Final = 10.0
"""Time constant of the noise estimate, s; sooner after the start it is the mean of all readings."""
YOUNG_CYCLES: Final = 50
"""Readings until the noise of a tactel is known by itself; before, it is at least what its board has in the
mean, and what is declared."""
SECOND_DIFFERENCE: Final = 6.0
"""Variance of p[t] - 2 p[t-1] + p[t-2], in variances of white noise; of a touch that grows evenly it is 0."""

# --- Zeros -----------------------------------------------------------------------------------------
EXPLAINED: Final = 3.0
"""Standard deviations of a zero within which drift explains a reading: chance exceeds them once in 370."""
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
COMMON: Final = 2.0
"""The zeros of a board drift together by this much more than they drift apart: they share temperature and
supply."""

# --- Creep -----------------------------------------------------------------------------------------
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
    common: Floats
    """(n_patches,) Pa^2, of what the zeros of a board have in common."""
    out: Bools
    """(n_tactels,) out of the zero band: what is read there is no pressure."""
    creep: Floats
    """(n_tactels,) Pa, standard deviation of what the cover may still show of what has pressed it."""


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
    common: Floats


class Baseline:
    """Subtracts the zeros from the pressures of an arm.

    ``tau_s``     time constant of following, s: long against a touch, short against warming up
    ``start_s``   time of which the mean is the first zero, s
    ``settle_s``  time from release to following again, s

    Columns whose names begin with an underscore are of tactels, (n_tactels,), or of patches, (n_patches,).
    """

    def __init__(self, arm: Arm, *, tau_s: float = 30.0, start_s: float = 0.5, settle_s: float = 1.0) -> None:
        check_arm(arm)
        if not (tau_s > 0.0 and start_s > 0.0 and settle_s >= 0.0):
            raise ValueError(
                f"wanted tau_s > 0, start_s > 0, settle_s >= 0; got {tau_s}, {start_s}, {settle_s}"
            )
        self.arm = arm
        self._tau, self._start_s, self._settle = tau_s, start_s, settle_s
        self._last_ns: int | None = None
        n, p = arm.n_tactels, arm.n_patches
        self._patch, self._first = np.asarray(arm.tactel_patch), np.asarray(arm.patch_start[:-1])
        self._beside, self._healthy = _beside(arm), np.array(arm.tactel_healthy)
        self._full, self._touch = limit_of(arm), np.array(arm.tactel_threshold)
        # beyond any count: what is read further from 0 counts as this
        self._most = np.maximum(self._full, 0.0) + 2.0 * (1.0 + np.abs(arm.tactel_offset)) * step_of(arm)
        self._ratio = np.clip(arm.tactel_release / np.maximum(self._touch, 1e-9), 0.0, 1.0)
        # a board that declares no noise: no division, no threshold of 0
        self._declared2 = np.maximum(arm.tactel_noise, 1e-3) ** 2
        self._band, self._drift = np.array(arm.tactel_zero_band), arm.tactel_zero_drift**2 / DRIFT_S
        self._common_drift = COMMON * COMMON * self._drift[self._first]
        self._zeroed = np.zeros(n, np.bool_)  # has a zero from readings
        self._centre, self._pressed = np.zeros((2, n))
        self._run, self._low_n, self._noise_n = np.zeros((3, n), np.int64)
        self._below, self._quick = np.zeros(n), self._declared2.copy()
        self._is_young, (self._last, self._earlier) = True, np.full((2, n), np.nan)
        # of the window: readings, sums of what is above the zero and of its square, whether it was touched
        self._n_read, self._sum, self._square, self._was_touched = np.zeros((4, n))
        self._patch_touched, self._explained = np.zeros((2, p), np.bool_)
        self._silent_s, self._quiet_s, self._window_s = np.zeros((3, p))
        self._own_quiet_s = np.full(p, np.inf)
        self._purpose, self._window_n = np.zeros((2, p), np.int64)
        self.felt = Felt(
            touched=np.zeros(n, np.int8),
            zero=np.zeros(n),
            variance=self._declared2.copy(),
            # no zero yet: one that is further off than the threshold looks like a touch
            doubt=(self._touch / 3.0) ** 2,
            common=np.zeros(p),
            out=np.zeros(n, np.bool_),
            creep=np.zeros(n),
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
        flags = np.ones(self.arm.n_patches, np.bool_) if fresh is None else np.asarray(fresh, np.bool_)
        if flags.shape != (self.arm.n_patches,):
            raise ValueError(f"fresh must have shape {(self.arm.n_patches,)}, got {flags.shape}")
        dt = 0.0 if self._last_ns is None else 1e-9 * (t_ns - self._last_ns)
        self._last_ns, dt = t_ns, min(max(dt, 0.0), STEP_MOST_S)
        seen = flags[self._patch] & self._healthy & np.isfinite(pressures)
        value = np.clip(np.where(seen, pressures, self._last), -self._most, self._most)
        second = value - 2.0 * self._last + self._earlier
        was_free = self.felt.touched == FREE
        # an onset is no noise, nor is a release
        self._earlier = np.where(seen, np.where(was_free, self._last, np.nan), self._earlier)
        self._last = value
        if self._is_young:
            self._begin_noise(seen)
        seen = self._feel(seen, flags, dt)
        learns = self._time(seen, flags, dt)
        learned = learns[self._patch] & self._zeroed
        first = was_free & ~self._zeroed & (self.felt.touched == FREE)
        if learns.any():
            seen = self._learn(seen & learned, dt) | (seen & first)
        self._measure_noise(seen & (learned | first), second, dt)
        pressures -= self.felt.zero

    def _begin_noise(self, seen: Bools) -> None:
        """Take what first readings have below zero for noise: nothing pulls a skin."""
        new = seen & (self._noise_n == 0)
        low = np.where(new, np.minimum(self._last - self._centre, 0.0), 0.0)
        mean2 = self._by_patch(low * low) / np.maximum(self._by_patch(low < 0.0), 1)
        self._quick[new] = np.maximum(mean2[self._patch], self._declared2)[new]
        self._noise_n[new] = 1
        self.felt.variance[new] = self._quick[new]

    def _feel(self, seen: Bools, fresh: Bools, dt: float) -> Bools:
        """Note what is touched, what is out of band and what may creep; return the tactels read in band."""
        w, value, before = self.felt, self._last, self.felt.touched != FREE
        sigma = np.sqrt(w.variance)
        away = value - self._centre
        crosses = np.where(w.out, np.abs(away) <= self._band, away < -self._band - CLIP * sigma)
        self._run = np.where(seen, np.where(crosses, self._run + 1, 0), self._run)
        turned = self._run >= WINDOW_CYCLES
        w.out[turned] ^= True
        self._run[turned] = 0
        seen = seen & ~w.out
        limit = np.maximum(self._touch, SIGMAS * sigma)
        above = value - w.zero
        limit = np.where(before, limit * self._ratio, np.maximum(limit, EXPLAINED * np.sqrt(w.doubt)))
        touched = np.where(seen & (above >= limit), np.where(before, HELD, TOUCHED), FREE)
        np.copyto(w.touched, touched, "unsafe", where=fresh[self._patch])
        self._patch_touched = np.where(fresh, self._by_patch(w.touched) > 0, self._patch_touched)
        self._silent_s = np.where(fresh, 0.0, self._silent_s + dt)
        lost = self._patch_touched & (self._silent_s > FORGET_S)
        if lost.any():
            self._patch_touched[lost] = False
            self._own_quiet_s[lost] = FORGET_S
            w.touched[lost[self._patch]] = FREE

        now = np.maximum(above, 0.0) * np.where(value >= self._full, CREEP_FULL_SCALE, 1.0)
        more = np.where(seen, now - self._pressed, 0.0)
        rise, fall = -math.expm1(-dt / CREEP_RISE_S), -math.expm1(-dt / CREEP_FALL_S)
        self._pressed += np.where(more > 0.0, rise, fall) * more
        np.copyto(w.creep, CREEP * np.maximum(self._pressed - now, 0.0), where=seen)
        return seen

    def _time(self, seen: Bools, fresh: Bools, dt: float) -> Bools:
        """Run the windows of patches, and let zeros that are not followed grow unsure; return who learns."""
        w, touched = self.felt, self._patch_touched
        blocked = touched | (self._beside & touched).any(axis=1) if touched.any() else touched
        self._quiet_s = np.where(blocked, 0.0, self._quiet_s + dt * fresh)
        self._own_quiet_s = np.where(touched, 0.0, self._own_quiet_s + dt * fresh)
        learns = fresh & ~blocked & (self._quiet_s + 0.5 * dt > self._settle) & (dt > 0.0)
        # what is left may be touched in every other cycle
        resting = self._own_quiet_s + 0.5 * dt <= self._settle
        pending = self._by_patch(self._healthy & ~self._zeroed) > 0
        purpose = np.where(resting, REST, np.where(pending & ~blocked, START, OFF))
        purpose = np.where(fresh, purpose, self._purpose)
        if purpose.any():
            self._run_windows(seen, purpose, fresh & (purpose != OFF), resting, dt)
        else:
            self._purpose = purpose
        waits = fresh & ~(blocked | learns)
        w.doubt[:] += np.where(waits[self._patch] | (learns[self._patch] & seen), 0.0, self._drift * dt)
        watched = learns & (self._by_patch(seen & self._zeroed) > 0)
        # each tactel is observed: there is nothing that only the board as a whole has
        w.common[:] = np.where(watched, 0.0, w.common + self._common_drift * dt * ~waits)
        return learns

    def _run_windows(self, seen: Bools, purpose: Any, on: Bools, resting: Bools, dt: float) -> None:
        """Take the means of windows; where their time is over, make zeros of them if that is right."""
        w, patch = self.felt, self._patch
        changed = purpose != self._purpose
        self._purpose = purpose
        begins = on & (changed | (self._window_n == 0))
        self._explained &= ~changed
        for column in (self._n_read, self._sum, self._square, self._was_touched):
            column[begins[patch]] = 0.0
        self._window_s = np.where(begins, 0.0, self._window_s) + dt * on
        self._window_n = np.where(begins, 0, self._window_n) + on
        taken, above = on[patch] & seen, self._last - w.zero
        self._n_read += taken
        self._sum[taken] += above[taken]
        self._square[taken] += above[taken] ** 2
        self._was_touched += taken & (w.touched != FREE)
        done = on & (self._window_s + 0.5 * dt >= self._start_s) & (self._window_n >= WINDOW_CYCLES)
        if not done.any():
            return
        self._window_n[done] = 0
        n = np.maximum(self._n_read, 1)
        mean, enough = self._sum / n, self._n_read >= WINDOW_CYCLES
        scatter = self._square - n * mean**2
        still = enough & (scatter <= (n - 1) * MOVING**2 * np.maximum(w.variance, self._declared2))
        still &= np.abs(w.zero + mean - self._centre) <= self._band
        new = (done & (purpose == START))[patch] & still & ~self._zeroed

        ends = done & (purpose == REST)
        self._explained[ends] = self._is_drift(mean, enough, still)[ends]
        released = ends & self._explained & ~(self._beside & resting & ~self._explained).any(axis=1)
        w.touched[released[patch]] = FREE
        new |= released[patch] & self._zeroed & enough
        w.common[released], self._patch_touched[released], self._own_quiet_s[released] = 0.0, False, np.inf
        w.zero[new] += mean[new]
        w.doubt[new] = (w.variance / n)[new]
        self._zeroed[new], self._low_n[new] = True, 0

    def _is_drift(self, mean: Floats, enough: Bools, still: Bools) -> Bools:
        """Return whether drift explains the means (Pa) of the windows of patches: together, and each."""
        w, n = self.felt, np.maximum(self._n_read, 1)
        variance = w.doubt + w.variance / n
        known = np.where(enough & (self._was_touched == 0), 1.0 / variance, 0.0)
        free = 1.0 + w.common * self._by_patch(known)
        shift, unsure = w.common * self._by_patch(known * mean) / free, w.common / free
        left2 = (mean - shift[self._patch]) ** 2
        explained = self._zeroed & still & (left2 <= EXPLAINED**2 * (variance + unsure[self._patch]))
        read = self._n_read > 0
        return np.asarray((self._by_patch(read & ~explained) == 0) & (self._by_patch(read) > 0))

    def _learn(self, at: Bools, dt: float) -> Bools:
        """Follow the zeros of free tactels; return those that are not below theirs."""
        w, slowest = self.felt, min(dt / self._tau, 1.0)
        # what a cover still shows of a press, or springs below, is noise that lasts
        noise2, e = w.variance + w.creep**2, self._last - w.zero
        most = CLIP * np.sqrt(noise2 + w.doubt)
        low = at & (e < -most)
        ok = at & ~low
        self._low_n = np.where(at, (self._low_n + 1) * low, self._low_n)
        if low.any():
            falls = low & (self._low_n >= max(WINDOW_CYCLES, LOW_S / dt - 0.5))
            # the whole of it, at once; it may as well come back
            w.zero[falls] = np.maximum(self._last, self._centre - self._band)[falls]
            w.doubt[falls] = np.minimum(e**2, (LOW_MOST * self._touch) ** 2)[falls]
            self._low_n[falls] = 0
        gain = np.minimum(w.doubt / (w.doubt + noise2), min(MOST_GAIN, dt / GAIN_S))
        gain = np.maximum(gain, slowest)
        zero = w.zero + gain * np.clip(e, -most, most)
        doubt = np.maximum((1.0 - gain) ** 2 * w.doubt + gain**2 * noise2, slowest * noise2)
        away = zero - self._centre
        left_band = ok & (np.abs(away) > self._band)
        zero = self._centre + np.clip(away, -self._band, self._band)
        w.out[left_band & (e * away > 0.0)] = True
        self._run[left_band] = 0
        np.copyto(w.zero, zero, where=ok)
        np.copyto(w.doubt, doubt, where=ok)
        return ok

    def _measure_noise(self, free: Bools, second: Floats, dt: float) -> None:
        """Follow the noise of free tactels by ``second`` (Pa) differences, and by what is below a zero.

        Below its zero all is noise. Above may be a press that grows slowly, whose squares would raise the
        threshold ahead of it; of quick noise, second differences show all.
        """
        w, e, most = self.felt, self._last - self.felt.zero, CLIP**2 * self.felt.variance
        free = free & np.isfinite(second)
        self._noise_n += free
        gain = np.maximum(1.0 / np.maximum(self._noise_n, 1), dt / (NOISE_S + dt))
        quick = np.minimum(second**2 / SECOND_DIFFERENCE, most) / CLIPPED_VARIANCE - self._quick
        self._quick += np.where(free, gain * quick, 0.0)
        below = np.minimum(e * e, most) / CLIPPED_VARIANCE - self._below
        self._below += np.where(free & self._zeroed & (e < 0.0), gain * below, 0.0)
        least = np.where(self._zeroed, NOISE_LEAST**2, 1.0) * self._declared2
        variance = np.maximum(np.maximum(self._quick, self._below), least)
        if self._is_young:
            young = (self._noise_n > 0) & (self._noise_n < YOUNG_CYCLES)
            self._is_young = bool((self._healthy & (self._noise_n < YOUNG_CYCLES)).any())
            mean = self._by_patch(self._quick * young) / np.maximum(self._by_patch(young), 1)
            least = np.maximum(mean[self._patch], self._declared2 * ~self._zeroed)
            variance = np.where(young, np.maximum(self._quick, least), variance)
            free |= young
        np.copyto(w.variance, variance, where=free)

    def _by_patch(self, column: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the sums of a column of tactels, (n_patches,)."""
        return np.add.reduceat(column, self._first, dtype=float if column.dtype == np.float64 else int)

    def zero(self, patch: int | None = None) -> None:
        """Let the next start take what it reads as zero, touched or not, on one patch or all.

        The zero band moves along: whoever asks for it says that nothing touches the skin.
        """
        w, p = self.felt, slice(None) if patch is None else slice(patch, patch + 1)
        i = np.isin(self._patch, np.arange(self.arm.n_patches)[p])
        read = i & np.isfinite(self._last)
        w.zero[read] = self._centre[read] = self._last[read]
        w.touched[i] = FREE
        self._zeroed[i] = w.out[i] = False
        self._noise_n[read], self._is_young = 1, True
        self._pressed[i] = w.creep[i] = 0.0
        self._run[i] = 0
        self._patch_touched[p] = False
        self._own_quiet_s[p] = np.inf
        self._purpose[p] = OFF

    def kept(self) -> KeptZeros:
        """Return what a restart must not lose."""
        w = self.felt
        return KeptZeros(
            zero=w.zero.copy(),
            doubt=w.doubt.copy(),
            centre=self._centre.copy(),
            variance=w.variance.copy(),
            zeroed=self._zeroed.copy(),
            touched=self.touched,
            pressed=self._pressed.copy(),
            common=w.common.copy(),
        )

    def resume(self, patch: int, kept: KeptZeros, age_s: float) -> int:
        """Take up the zeros of one patch, ``age_s`` old; return of how many tactels.

        kept: of this patch alone: columns of its tactels, ``common`` of shape (1,).

        Their variances have grown with the declared drift. A tactel without a zero begins as at power-on, and
        so does one whose zero may have drifted on its own by its threshold since. What the board has drifted
        in common its free tactels show.
        """
        w, i = self.felt, self.arm.tactels_of(patch)
        grown = self._drift[i] * age_s
        taken = kept.zeroed & self._healthy[i] & (EXPLAINED**2 * grown <= self._touch[i] ** 2)
        noise2 = np.maximum(kept.variance, NOISE_LEAST**2 * self._declared2[i])
        news: list[tuple[npt.NDArray[Any], Any]] = [
            (w.zero, np.clip(kept.zero, -self._most[i], self._most[i])),
            (self._centre, np.clip(kept.centre, -self._most[i], self._most[i])),
            (w.doubt, kept.doubt + grown),
            *((column, noise2) for column in (w.variance, self._below, self._quick)),
            (w.touched, np.where(kept.touched, HELD, FREE)),
            (self._zeroed, True),
            (self._noise_n, 10**6),
        ]
        for column, new in news:
            column[i] = np.where(taken, new, column[i])
        self._pressed[i] = kept.pressed * math.exp(-age_s / CREEP_FALL_S)
        if taken.any():
            w.common[patch] = kept.common[0] + self._common_drift[patch] * age_s
        if (kept.touched & taken).any():
            self._patch_touched[patch] = True
            self._own_quiet_s[patch] = 0.0
        return int(taken.sum())

    @property
    def zeros(self) -> Floats:
        """(n_tactels,) Pa, what is subtracted."""
        return self.felt.zero.copy()

    @property
    def zero_sd(self) -> Floats:
        """(n_tactels,) Pa, standard deviation of each zero, apart from what a board has in common."""
        return np.sqrt(self.felt.doubt)

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
        return np.asarray(self.touched & ~self._zeroed)

    @property
    def out_of_band(self) -> Bools:
        """(n_tactels,) reads below the zero band, or its zero has left it; its readings are not used."""
        return self.felt.out.copy()


def _beside(arm: Arm) -> Bools:
    """Return which patches of one link have corners that may come close, (n_patches, n_patches)."""
    half = np.array([0.5 * math.hypot(*placed.patch.size) for placed in arm.patches])
    near = np.zeros((arm.n_patches, arm.n_patches), np.bool_)
    for k, link in enumerate(arm.links):
        (p,) = np.nonzero(arm.patch_link == k)
        s, a = arm.patch_s[p], arm.patch_a[p]
        d = link.surface.distance(s[:, None], a[:, None], s, a)
        near[np.ix_(p, p)] = d <= half[p, None] + half[p] + ADJOINING
    return near & ~np.eye(arm.n_patches, dtype=np.bool_)
