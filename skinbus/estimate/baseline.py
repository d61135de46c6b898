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
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.columns import filled
from skinbus.estimate.kernels.array_table import array_table
from skinbus.estimate.kernels.layout import limit_of, step_of
from skinbus.estimate.kernels.workspace import FREE, HELD
from skinbus.estimate.kernels.zero_columns import Zeros
from skinbus.estimate.kernels.zero_noise import NOISE_LEAST, NOISE_S, SIGMAS
from skinbus.estimate.kernels.zeros import COMMON, CREEP_FALL_S, EXPLAINED, OFF, follow
from skinbus.estimate.validation import check_arm, check_time
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Touches = npt.NDArray[np.int8]

STEP_MOST_S: Final = 1.0
"""A longer gap counts as this: nothing is learned from time in which nothing was read."""
ADJOINING: Final = 10e-3
"""Patches whose corners may be this close adjoin, m: the reach of a contact's skirt."""
DRIFT_S: Final = 60.0
"""The declared drift is the standard deviation of the change of a zero in this time, s."""


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
    """

    def __init__(self, arm: Arm, *, tau_s: float = 30.0, start_s: float = 0.5, settle_s: float = 1.0) -> None:
        check_arm(arm)
        if not (tau_s > 0.0 and start_s > 0.0 and settle_s >= 0.0):
            raise ValueError(
                f"wanted tau_s > 0, start_s > 0, settle_s >= 0; got {tau_s}, {start_s}, {settle_s}"
            )
        self.arm = arm
        self._times = (tau_s, start_s, settle_s)
        self._all = np.ones(arm.n_patches, np.bool_)
        self._last_ns: int | None = None
        idle = array_table(_make_columns(arm))  # the call that compiles also counts
        follow(idle, np.full(arm.n_tactels, np.nan), self._all, 0.0, *self._times)
        self._zeros = w = _make_columns(arm)
        self._table = array_table(w)
        self.felt = Felt(w.touched, w.zero, w.variance, w.doubt, w.common, w.out, w.creep)
        """Its state, without copies: for what runs in the cycle."""

    def apply(self, pressures: Floats, t_ns: int, fresh: npt.ArrayLike | None = None) -> None:
        """Subtract the zeros from pressures in place, and learn from them.

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
        follow(self._table, own, flags, min(max(dt, 0.0), STEP_MOST_S), *self._times)
        if own is not pressures:
            pressures[:] = own

    def zero(self, patch: int | None = None) -> None:
        """Let the next start take what it reads as zero, touched or not, on one patch or all.

        The zero band moves along: whoever asks for it says that nothing touches the skin.
        """
        w = self._zeros
        patches = range(self.arm.n_patches) if patch is None else [patch]
        for p in patches:
            i = slice(w.start[p], w.start[p + 1])
            read = np.isfinite(w.last[i])
            for column in (w.zero, w.centre):
                column[i][read] = w.last[i][read]
            w.touched[i] = FREE
            w.zeroed[i] = w.out[i] = False
            w.first_variance[i] = w.variance[i]
            w.pressed[i] = w.creep[i] = 0.0
            w.run[i] = 0
            w.patch_touched[p] = False
            w.own_quiet_s[p] = np.inf
            w.window[p] = OFF
            w.pending[p] = int(w.healthy[i].sum())

    def kept(self) -> KeptZeros:
        """Return what a restart must not lose."""
        w = self._zeros
        return KeptZeros(
            zero=w.zero.copy(),
            doubt=w.doubt.copy(),
            centre=w.centre.copy(),
            variance=w.variance.copy(),
            zeroed=w.zeroed.copy(),
            touched=np.asarray(w.touched != FREE),
            pressed=w.pressed.copy(),
            common=w.common.copy(),
        )

    def resume(self, patch: int, kept: KeptZeros, age_s: float) -> int:
        """Take up the zeros of one patch, ``age_s`` old; return of how many tactels.

        kept: of this patch alone: columns of its tactels, ``common`` of shape (1,).

        Their variances have grown with the declared drift. A tactel without a zero begins as at power-on, and
        so does one whose zero may have drifted on its own by its threshold since. What the board has drifted
        in common its free tactels show.
        """
        w, p = self._zeros, patch
        i = slice(w.start[p], w.start[p + 1])
        grown = w.drift[i] * age_s
        taken = kept.zeroed & w.healthy[i] & (EXPLAINED * EXPLAINED * grown <= w.touch[i] ** 2)
        w.zero[i][taken] = np.clip(kept.zero, -w.most[i], w.most[i])[taken]
        w.centre[i][taken] = np.clip(kept.centre, -w.most[i], w.most[i])[taken]
        w.doubt[i][taken] = (kept.doubt + grown)[taken]
        least = (NOISE_LEAST * w.declared[i]) ** 2
        for column in (w.variance, w.below, w.quick):
            column[i][taken] = np.maximum(kept.variance, least)[taken]
        w.noise_s[i][taken] = NOISE_S
        w.touched[i][taken] = np.where(kept.touched, HELD, FREE)[taken]
        w.pressed[i] = kept.pressed * math.exp(-age_s / CREEP_FALL_S)
        w.zeroed[i][taken] = True
        w.pending[p] = int((w.healthy[i] & ~w.zeroed[i]).sum())
        if taken.any():
            w.common[p] = kept.common[0] + COMMON * COMMON * w.drift[w.start[p]] * age_s
        if (kept.touched & taken).any():
            w.patch_touched[p] = True
            w.own_quiet_s[p] = 0.0
        return int(taken.sum())

    @property
    def zeros(self) -> Floats:
        """(n_tactels,) Pa, what is subtracted."""
        return self._zeros.zero.copy()

    @property
    def zero_sd(self) -> Floats:
        """(n_tactels,) Pa, standard deviation of each zero, apart from what a board has in common."""
        return np.sqrt(self._zeros.doubt)

    @property
    def noise(self) -> Floats:
        """(n_tactels,) Pa, standard deviation measured while free."""
        return np.sqrt(self._zeros.variance)

    @property
    def threshold(self) -> Floats:
        """(n_tactels,) Pa, from which on a tactel is touched."""
        return np.maximum(self._zeros.touch, SIGMAS * self.noise)

    @property
    def touched(self) -> Bools:
        """(n_tactels,) touched, with hysteresis."""
        return np.asarray(self._zeros.touched != FREE)

    @property
    def suspect(self) -> Bools:
        """(n_tactels,) touched ever since power came: a touch at power-on, or a zero that is far off."""
        return np.asarray(self.touched & ~self._zeros.zeroed)

    @property
    def out_of_band(self) -> Bools:
        """(n_tactels,) reads below the zero band, or its zero has left it; its readings are not used."""
        return self._zeros.out.copy()


_BY_PATCH: Final = ("common", "patch_touched", "explained", "silent_s", "quiet_s", "window_s", "window_n")
"""Columns of zeros by patch; the others are by tactel."""


def _make_columns(arm: Arm) -> Zeros:
    """Return the columns of an arm before its first reading."""
    n, p = arm.n_tactels, arm.n_patches
    beside = [_beside(arm, k) for k in range(p)]
    # a board that declares no noise: no division, no threshold of 0
    declared = np.maximum(arm.tactel_noise, 1e-3)
    return filled(
        Zeros,
        n,
        dict.fromkeys(_BY_PATCH, p),
        start=arm.patch_start.astype(np.int64),
        beside_start=np.concatenate([[0], np.cumsum([len(b) for b in beside])]).astype(np.int64),
        beside=np.concatenate(beside).astype(np.int64),
        healthy=np.array(arm.tactel_healthy),
        most=np.maximum(limit_of(arm), 0.0) + 2.0 * (1.0 + np.abs(arm.tactel_offset)) * step_of(arm),
        full=limit_of(arm),
        touch=np.array(arm.tactel_threshold),
        ratio=np.clip(arm.tactel_release / np.maximum(arm.tactel_threshold, 1e-9), 0.0, 1.0),
        declared=declared,
        band=np.array(arm.tactel_zero_band),
        drift=arm.tactel_zero_drift**2 / DRIFT_S,
        # no zero yet: one that is further off than the threshold looks like a touch
        doubt=(arm.tactel_threshold / 3.0) ** 2,
        variance=declared**2,
        below=declared**2,
        quick=declared**2,
        last=np.full(n, np.nan),
        earlier=np.full(n, np.nan),
        second=np.full(n, np.nan),
        first_variance=declared**2,
        own_quiet_s=np.full(p, np.inf),
        window=np.full(p, OFF, np.int64),
        pending=np.add.reduceat(arm.tactel_healthy, arm.patch_start[:-1], dtype=np.int64),
    )


def _beside(arm: Arm, p: int) -> Ints:
    """Return the patches of the same link whose corners may come close to those of patch p."""
    link = int(arm.patch_link[p])
    half = np.array([0.5 * math.hypot(*placed.patch.size) for placed in arm.patches])
    d = arm.links[link].surface.distance(arm.patch_s[p], arm.patch_a[p], arm.patch_s, arm.patch_a)
    near = (arm.patch_link == link) & (d <= half + half[p] + ADJOINING)
    near[p] = False
    return np.flatnonzero(near)
