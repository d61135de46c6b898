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

Readings that come again bit by bit, although the noise of the tactel shows in others, are not those of a new
sample. As soon as that is too unlikely to be chance, of tactels that follow each other together, they are
missing; where they are all of the board, it is withheld (``is_withheld``), every time. Such runs teach no
rate of change.

Two contacts may look like one to the neighbours of a tactel, so one touch that it has not felt proves
nothing, however often it comes; any reading of a pressure proves that it lives. A tactel comes back when it
has been plausible for a second, a dead one when it has felt something for ten readings.

Failure mode: a touch that no other tactel feels, such as one beyond a corner, says nothing of the corner; a
board whose readings never change has no rate of change, and is never frozen; lone means lone on a board: what
a tactel at its edge would share with the next board is not asked; a board that takes samples at a lower rate
than the SYNC is fresh in each cycle.
"""

from __future__ import annotations

from enum import IntFlag
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from skinbus.estimate.baseline import Baseline
from skinbus.estimate.columns import filled
from skinbus.estimate.kernels import plausible, silence
from skinbus.estimate.kernels.array_table import array_table
from skinbus.estimate.kernels.layout import limit_of, step_of
from skinbus.estimate.kernels.plausible import JUMP_CYCLES, judge
from skinbus.estimate.kernels.silence import NARROW, NEXT, PLACES, SPAN, WIDTH, Columns
from skinbus.estimate.validation import check_arm, check_time
from skinbus.model import Arm, Law

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Singles = npt.NDArray[np.float32]


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
LIGHT_N: Final = 1.0
"""Force by whose law a reading is judged beside others, N."""


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
        self.is_repeated = self._columns.is_repeated
        """(n_patches,) whether all readings of this cycle have come again and are withheld for it, live."""
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


_BY_PATCH: Final = (
    *("window_n", "turn", "quiet_s", "is_full", "is_crushed", "is_repeated", "is_withheld", "n_faulty"),
)
"""Columns of zeros by patch; the others are by tactel."""


def _columns(arm: Arm) -> Columns:
    """Return the columns of an arm before its first reading."""
    n, p, patch = arm.n_tactels, arm.n_patches, arm.tactel_patch
    # the mean in the middle of a step
    most = erf(step_of(arm) / (np.sqrt(8.0) * np.maximum(arm.tactel_noise, 1e-300)))
    lowest, step = np.array(
        [(-1.0 - t.full_counts, t.step) for t in (placed.patch.transducer for placed in arm.patches)]
    )[patch].T
    return filled(
        Columns,
        n,
        dict.fromkeys(_BY_PATCH, p),
        start=arm.patch_start.astype(np.int64),
        healthy=np.array(arm.tactel_healthy),
        high=limit_of(arm),
        low=(lowest - arm.tactel_offset) * step * np.abs(arm.tactel_gain) + 0.5 * step_of(arm),
        sigma=np.maximum(np.sqrt(arm.tactel_noise**2 + step_of(arm) ** 2 / 12.0), 1e-3),
        touch=np.array(arm.tactel_threshold),
        up=np.zeros(PLACES**2),
        down=np.zeros(PLACES**2),
        last=np.full(n, np.nan),
        quiet=np.log(np.where(step_of(arm) > 0.0, most, 1.0)),
        before=np.full(n, np.nan),
        jump_age=np.full(n, JUMP_CYCLES + 1, np.int64),
        **_tables(arm),
    )


def _tables(arm: Arm) -> dict[str, Any]:
    """Return the neighbours of tactels, and what the law gives them of contacts around; kinds share rows."""
    axis = np.linspace(-SPAN, SPAN, PLACES)
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    rows_of: dict[bytes, int] = {}
    wide: list[Singles] = []
    columns: dict[str, list[Any]] = {name: [] for name in ("near", "away", "own_row", "tried_row")}
    narrow: list[Singles] = []
    for p, placed in enumerate(arm.patches):
        uv = placed.patch.tactels_uv
        d = np.linalg.norm(uv[:, None] - uv, axis=-1)
        pitch = float(np.where(d > 0.0, d, np.inf).min())
        pitch = pitch if pitch < np.inf else placed.patch.diameter
        around = [np.flatnonzero((row <= REACH * pitch) & (row > 0.0)) for row in d]
        steps = [(uv[row] - uv[i]) / pitch for i, row in enumerate(around)]
        off = np.linalg.norm(np.concatenate([np.zeros((1, 2)), *steps])[:, None] - places, axis=-1)
        table = _part_of_peak(placed.patch.law, pitch * off / WIDTH)
        own = rows_of.setdefault(table.tobytes(), sum(map(len, wide)))
        if own == sum(map(len, wide)):
            wide.append(table)
            narrow.append(_part_of_peak(placed.patch.law, pitch * off / NARROW))
        columns["own_row"].append(own)
        columns["tried_row"].append(own + 1 + np.cumsum([0, *map(len, around[:-1])]))
        columns["near"] += [arm.patch_start[p] + row for row in around]
        columns["away"] += steps
    away = np.concatenate(columns["away"])
    return {
        "neighbour_start": np.cumsum([0, *map(len, columns["near"])]),
        "neighbour": np.concatenate(columns["near"]).astype(np.int64),
        "away": away,
        "is_next": np.linalg.norm(away, axis=-1) < NEXT,
        "wide": np.concatenate(wide),
        "narrow": np.concatenate(narrow),
        "own_row": np.array(columns["own_row"]),
        "tried_row": np.concatenate(columns["tried_row"]),
    }


def _part_of_peak(law: Law, d: Floats) -> Singles:
    """Return what is left of the peak of a light touch at distances, m: of a cone, the narrowest it makes."""
    return np.asarray(law.pressure(d, LIGHT_N) / law.pressure(np.zeros(1), LIGHT_N), np.float32)
