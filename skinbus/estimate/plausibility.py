"""Which tactels are plausible: what an implausible one reads is missing, not zero.

Rail:      at the lower end of the converter, and missing at once; alone at a pressure of which the law of the
           board, for a narrow contact anywhere around, gives its neighbours more than they read, and missing
           at once; or at full scale with its whole board, of which half was not near it before: the board is
           withheld at once. What came to full scale
           alone is missing until it leaves it, whatever touches beside it
Frozen:    not a bit changes, for a time in which it would have changed at the rate it did while free, or
           while half of its board is frozen
Dead:      reads less than a tenth of the least that it should have felt in two touches in a row, in two
           places: every contact that explains its neighbours by the law of the board would press it. Readings
           are averaged while a touch stays where it is
Jumping:   it leaves and comes back within three cycles while its neighbours do not change at all, five times
           in five seconds
Band:      below its zero band, or its zero has left it (``Baseline``)

Readings that come again bit by bit, although noise is declared and was seen, are not those of a new sample.
As soon as that is too unlikely to be chance, of some tactels of a board together, they are missing; where
they are all of the board, it is withheld (``is_withheld``), every time. One tactel alone, or some that follow
each other, are missing after a few, and sooner if those around them change: by as much as they do, a
repetition is less likely. Such runs teach no rate of change. A board that again and again repeats all
readings, then changes by noise, takes samples at a lower rate than the SYNC. Readings are compared with what
came last, used or not. The first reading of a board after a pause in which nothing came may be as old as the
pause: it is withheld. So are boards whose readings are equal bit by bit in one cycle, though noise shows on
them, and a board that reads what another read in the cycle before.

Two contacts may look like one to the neighbours of a tactel, so one touch that it has not felt proves
nothing, however often it comes; any reading of a pressure proves that it lives. A tactel comes back when it
has been plausible for a second, a dead one when it has felt something for ten readings.

Failure mode: a touch that no other tactel feels, such as one beyond a corner, says nothing of the corner; a
board whose readings never change has no rate of change, and is never frozen; lone means lone on a board: what
a tactel at its edge would share with the next board is not asked.
"""

from __future__ import annotations

from enum import IntFlag
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from skinbus.estimate.baseline import Baseline
from skinbus.estimate.columns import filled
from skinbus.estimate.kernels import plausible, silence
from skinbus.estimate.kernels.array_table import array_table
from skinbus.estimate.kernels.judged_columns import Columns
from skinbus.estimate.kernels.layout import limit_of, step_of
from skinbus.estimate.kernels.neighbours import PROFILE, PROFILE_SPAN
from skinbus.estimate.kernels.plausible import JUMP_CYCLES, ONSET_CYCLES, judge
from skinbus.estimate.kernels.silence import FINE, PLACES, SPAN, WIDTH
from skinbus.estimate.validation import check_arm, check_time
from skinbus.model import Arm, Cone, Patch

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]


class TactelFault(IntFlag):
    """What is wrong with a tactel."""

    BAND = plausible.BAND
    """Reads below its zero band, or its zero has left the band."""
    RAIL = plausible.RAIL
    """At the lower end of the converter, or alone at a pressure that no contact explains."""
    FROZEN = plausible.FROZEN
    DEAD = silence.DEAD
    JUMPING = plausible.JUMPING


REACH: Final = 2.3
"""Pitches within which tactels of a board are neighbours: two steps on a square, but for the corners."""


class Plausibility:
    """Judges the readings of an arm, cycle by cycle."""

    def __init__(self, arm: Arm) -> None:
        check_arm(arm)
        self.arm = arm
        self._last_ns: int | None = None
        n, p = arm.n_tactels, arm.n_patches
        idle, free, no = array_table(_columns(arm)), np.zeros(n, np.int8), np.zeros(n, np.bool_)
        judge(idle, np.full(n, np.nan), np.zeros(n), free, no, np.zeros(p, np.bool_), 0.0)  # compiled now
        self._columns = _columns(arm)
        self._table = array_table(self._columns)
        self.faults = self._columns.fault
        """(n_tactels,) :class:`TactelFault` bits, live."""
        self.is_withheld = self._columns.is_withheld
        """(n_patches,) whether the newest readings are of an earlier sample, or all at full scale, live."""
        self.is_repeated = np.zeros(arm.n_patches, np.bool_)
        """(n_patches,) whether all readings of this cycle have come again and are withheld for it, live."""
        self.is_copied = self._columns.is_copied
        """(n_patches,) whether the readings of this cycle are those of another board, and withheld, live."""
        self.n_faulty = self._columns.n_faulty
        """(n_patches,) tactels that have any, live."""

    def resume(self, patch: int, faults: Ints) -> None:
        """Begin with the faults (n_tactels of the patch,) that were found before; they heal as any others.

        What is out of its band the baseline finds anew.
        """
        w = self._columns
        i = slice(w.start[patch], w.start[patch + 1])
        known = sum(fault for fault in TactelFault if fault is not TactelFault.BAND)
        w.fault[i] = np.where(w.healthy[i], faults & known, 0)
        w.n_faulty[patch] = np.count_nonzero(w.fault[i])

    def judge(self, pressures: Floats, t_ns: int, fresh: Bools, baseline: Baseline) -> None:
        """Judge the readings of a cycle, and make those that are not plausible NaN, in place.

        Those that are only out of their band stay: the baseline needs them, and marks them itself.

        pressures: (n_tactels,) float64, Pa, calibrated, before any zero is subtracted.
        fresh:     (n_patches,) False where readings are missing.
        baseline:  as the last cycle has left it.
        """
        t_ns = check_time(t_ns)
        dt = 0.0 if self._last_ns is None else min(max(1e-9 * (t_ns - self._last_ns), 0.0), 1.0)
        self._last_ns = t_ns
        felt = baseline.felt
        judge(self._table, pressures, felt.zero, felt.touched, felt.out, fresh, dt)
        np.logical_and(self.is_withheld, fresh, out=self.is_repeated)
        self.is_repeated &= self._columns.same > 0


_BY_PATCH: Final = (
    *("turn", "pause", "longest", "same", "slow_n", "noise_n", "is_full", "is_crushed"),
    *("is_withheld", "code", "code_before", "is_copied", "window_n", "mean_n", "n_faulty"),
)
"""Columns of zeros by patch; the others are by tactel."""


def _columns(arm: Arm) -> Columns:
    """Return the columns of an arm before its first reading."""
    n, p, patch = arm.n_tactels, arm.n_patches, arm.tactel_patch
    near, away = _neighbours(arm)
    profile, slope = zip(*[_law(placed.patch) for placed in arm.patches], strict=True)
    tried, tried_row, own_row = _tried(arm)
    n_fine = FINE * FINE
    high = limit_of(arm)
    lowest = np.array([-1.0 - placed.patch.transducer.full_counts for placed in arm.patches])[
        arm.tactel_patch
    ]
    step = np.array([placed.patch.transducer.step for placed in arm.patches])[patch]
    margin = 0.5 * step_of(arm)
    return filled(
        Columns,
        n,
        dict.fromkeys(_BY_PATCH, p),
        start=arm.patch_start.astype(np.int64),
        healthy=np.array(arm.tactel_healthy),
        high=high,
        low=(lowest - arm.tactel_offset) * step * np.abs(arm.tactel_gain) + margin,
        sigma=np.maximum(np.sqrt(arm.tactel_noise**2 + step_of(arm) ** 2 / 12.0), 1e-3),
        touch=np.array(arm.tactel_threshold),
        neighbour_start=_starts(near),
        neighbour=np.concatenate(near).astype(np.int64),
        away=away,
        counts=np.zeros(len(away), np.bool_),
        profile=np.array(profile),
        slope=np.array(slope),
        tried=tried,
        tried_row=tried_row,
        own_row=own_row,
        fine=np.zeros((1 + max(len(row) for row in near), n_fine), np.float32),
        up=np.zeros(n_fine),
        down=np.zeros(n_fine),
        last=np.full(n, np.nan),
        newest=np.full(n, np.nan),
        n_unused=np.full(p, ONSET_CYCLES),
        before=np.full(n, np.nan),
        jump_age=np.full(n, JUMP_CYCLES + 1, np.int64),
        quiet=_quiet(arm),
        step=step_of(arm),
        offset=np.array(arm.tactel_offset),
        where=np.zeros((n, 2)),
        best=np.zeros(1, np.int64),
        quiet_s=np.full(p, np.inf),
    )


def _quiet(arm: Arm) -> Floats:
    """Return the log of the largest chance of any value of a reading, by the declared noise, (n_tactels,).

    No two readings are equal with a larger one, whatever the pressure: that of the value whose step has the
    mean in its middle.
    """
    step, noise = step_of(arm), np.maximum(arm.tactel_noise, 1e-300)
    return np.asarray(np.log(np.where(step > 0.0, erf(step / (np.sqrt(8.0) * noise)), 1.0)))


def _starts(rows: list[Ints]) -> Ints:
    return np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int64)


def _around(patch: Patch) -> list[tuple[Ints, Floats]]:
    """Return the neighbours of each tactel of a patch, and where they are (m, 2), in pitches."""
    uv, pitch = patch.tactels_uv, _pitch(patch)
    rows = []
    for i in range(len(uv)):
        d = np.linalg.norm(uv - uv[i], axis=-1)
        near = np.flatnonzero((d <= REACH * pitch) & (d > 0.0))
        rows.append((near, (uv[near] - uv[i]) / pitch))
    return rows


def _neighbours(arm: Arm) -> tuple[list[Ints], Floats]:
    """Return the neighbours of each tactel, and where they are (m, 2), in pitches."""
    near, away = [], []
    for p, placed in enumerate(arm.patches):
        for around, there in _around(placed.patch):
            near.append(int(arm.patch_start[p]) + around)
            away.append(there)
    return near, np.concatenate(away)


def _tried(arm: Arm) -> tuple[npt.NDArray[np.float32], Ints, Ints]:
    """Return ``tried``, ``tried_row`` and ``own_row`` of the columns; boards of one kind share rows."""
    axis = np.linspace(-SPAN, SPAN, PLACES)
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    known: dict[bytes, tuple[int, Ints]] = {}
    tables: list[Floats] = []
    n_rows = 0
    own_row, tried_row = [], []
    knots = np.linspace(0.0, PROFILE_SPAN, PROFILE)
    for placed in arm.patches:
        patch = placed.patch
        profile, slope = _law(patch)
        key = patch.tactels_uv.tobytes() + profile.tobytes() + bytes([slope > 0.0])
        if key not in known:
            around = _around(patch)
            there = np.concatenate([np.zeros((1, 2)), *(away for _, away in around)])
            d = np.linalg.norm(there[:, None] - places, axis=-1) / WIDTH
            tables.append(d if slope > 0.0 else np.interp(d, knots, profile, right=0.0))
            known[key] = n_rows, n_rows + 1 + _starts([near for near, _ in around])[:-1]
            n_rows += len(there)
        own, rows = known[key]
        own_row.append(own)
        tried_row.append(rows)
    return (
        np.concatenate(tables).astype(np.float32),
        np.concatenate(tried_row),
        np.array(own_row, np.int64),
    )


def _pitch(patch: Patch) -> float:
    """Return the least distance of two tactels, m; of a single one, its diameter."""
    uv = patch.tactels_uv
    d = np.linalg.norm(uv[:, None] - uv[None], axis=-1)
    d[d == 0.0] = np.inf
    return float(d.min()) if np.isfinite(d).any() else patch.diameter


def _law(patch: Patch) -> tuple[Floats, float]:
    """Return profile and slope of the law of a patch in pitches."""
    pitch = _pitch(patch)
    if isinstance(patch.law, Cone):
        return np.zeros(PROFILE), patch.law.slope * pitch
    profile = patch.law.profile(np.linspace(0.0, PROFILE_SPAN, PROFILE) * pitch)
    return profile / profile[0], 0.0
