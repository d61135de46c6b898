"""Which tactels are plausible: what an implausible one reads is missing, not zero.

Rail:      missing at once. It is at the lower end of the converter; or alone at a pressure under which its
           neighbours would read more than they do, by the law of the board for a narrow contact anywhere
           around; or at full scale with its whole board, most of which was far from it in the reading
           before: then the board is withheld. What came to full scale alone is missing until it leaves it,
           whatever touches beside it
Frozen:    not a bit changes, for a time in which it would have changed at the rate it did while free, if
           its noise is more than about half a step of its converter
Dead:      reads less than a tenth of the least that it should have felt in two touches, in two places, and
           nothing in between: every contact that explains its neighbours by the law of the board would press
           it. In each cycle one of the silent tactels beside the strongest of a touched board is looked at
Jumping:   it begins to read alone what no contact explains, some five times in ten seconds
Band:      below its zero band, or its zero has left it (``Baseline``)

Readings that come again bit by bit, although the noise of the tactel shows in others, are not those of a new
sample. As soon as that is too unlikely to be chance, of tactels that follow each other together (those of a
PDO come again together), they are missing; where they are all of the board, it is withheld (``is_withheld``),
every time. They teach no rate of change.

Two contacts may look like one to the neighbours of a tactel, so one touch that it has not felt proves
nothing, however often it comes; any reading of a pressure proves that it lives. A tactel comes back when it
has been plausible for a second, a dead one as soon as it feels something.

Failure mode: a touch that no other tactel feels, such as one beyond a corner, says nothing of the corner; a
board whose readings never change has no rate of change, and is never frozen; lone means lone on a board: what
a tactel at its edge would share with the next board is not asked; a board that takes samples at a lower rate
than the SYNC is fresh in each cycle.
"""

from __future__ import annotations

import math
from enum import IntFlag
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from skinbus.arrays import Bools, Bytes, Floats, Ints
from skinbus.estimate.baseline import EXPLAINED, FORGET_S, SETTLE_S, SIGMAS, Baseline
from skinbus.estimate.kernels.layout import limit_of, step_of
from skinbus.model import Arm, Law
from skinbus.model.validation import check_arm, check_time


class TactelFault(IntFlag):
    """What is wrong with a tactel."""

    BAND = 1
    """Reads below its zero band, or its zero has left the band."""
    RAIL = 2
    """At the lower end of the converter, or alone at a pressure that no contact explains."""
    FROZEN = 4
    DEAD = 8
    JUMPING = 16


BAND, RAIL, FROZEN, DEAD, JUMPING = map(int, TactelFault)
JUDGED = RAIL | FROZEN | DEAD | JUMPING
"""What is found here; of its band the baseline knows."""

# --- Rails and jumps -------------------------------------------------------------------------------
BOTTOM = 0.95
"""Of full scale below zero: no healthy tactel reads so little."""
WRONG_S, WRONG_TIMES = 0.2, 5
"""At a rail for so long, and so many readings: within half a second at 10 Hz and more, and no bit error. So
many jumps within ``FORGET_S``: a bit error now and then is not a fault of the tactel."""
LEAST_FULL = 4
"""Tactels of a board that all of them are: one contact may saturate fewer."""
LEAP = 0.5
"""Of full scale: what comes there by more at once, and alone, is stuck; or the supply of the board fails."""
LONE = 0.2
"""Of what a contact gives the neighbours of a tactel they read at least this part: gains differ by 10 %, and
the skirt of a tip of 2 mm is half of what the law says."""
BEYOND = 4.0
"""Highest peak of a contact beside a tactel that is considered, in full scales: 170 N on the usual board."""

# --- Readings that come again ----------------------------------------------------------------------
SHOWN = 0.45
"""Share of readings of a free tactel that come again, with four standard errors, below which noise shows at
every pressure. Noise of less than half a step repeats half of them where it is between two steps, and all in
the middle of one."""
FORGET_CYCLES = 2000
"""It is that of the last so many cycles."""
CHANCE = math.log(1e-5)
"""Chance of repetitions of tactels in a row to be new samples, below which they are missing. A board is
withheld at its square, once in four months at 1 kHz, and a tactel frozen at its sixth power: a pressed
reading may lie in the middle of a step, where it changes less often."""

# --- What neighbours say ---------------------------------------------------------------------------
REACH, NEXT = 2.3, 1.5
"""Pitches within which tactels of a board are neighbours: two steps on a square, but for the corners; and
within which they are next to each other."""
PLACES, SPAN = 17, 1.75
"""Places of a contact that are tried along each axis, and how far they reach, in pitches. Any contact that is
felt beside a tactel, but not by it, is among them, and a reading changes by no more than the law's error from
one to the next."""
WIDTH = 0.92
"""Of the narrowest contact, a tip of 2 mm, part of that of the law."""
LIKELY, TOLERANCE = 6.0, 0.1
"""chi^2 within which another place explains the neighbours too; the law's error, part of the peak."""
ELSEWHERE = 0.5
"""Pitches between two contacts that a dead tactel should have felt: one may be two that look like one, and
press the same place again and again."""
DEAD_SHARE = 0.1
"""A dead tactel reads less than this part of the least it should have: beside a tip of 2 mm, for which the
law is too wide, a healthy one may read a tenth."""
FEELS = 5.0
"""Standard deviations from which a tactel feels something: it is not dead."""


class Plausibility:
    """Judges the readings of an arm, cycle by cycle."""

    def __init__(self, arm: Arm) -> None:
        check_arm(arm)
        self.arm, n, m = arm, arm.n_tactels, arm.n_patches
        self._patch, self._first = arm.tactel_patch, arm.patch_start[:-1]
        self._near, self._row, self._law, self._is_next = _neighbours(arm)
        step, self._high = step_of(arm), limit_of(arm)
        self._low = -BOTTOM * self._high
        self._sigma = np.maximum(np.sqrt(arm.tactel_noise**2 + step**2 / 12.0), 1e-3)
        self._jump = np.maximum(arm.tactel_threshold, 2.0 * SIGMAS * self._sigma)  # twice what is a touch
        # largest chance of a reading to come again, by the declared noise: the mean in the middle of a step
        most = erf(step / (np.sqrt(8.0) * np.maximum(arm.tactel_noise, 1e-300)))
        self._most = np.where(step > 0.0, most, 1.0)
        self._value, self._state = np.zeros(n), np.zeros((7, n))
        self._state[2] = 1.0  # noise is not known to show
        self._is_full = np.zeros(m, np.bool_)
        # where a contact was that a tactel, silent since, should have felt: in any touch, in an earlier one
        self._missed_at, self._turn = np.full((2, n), np.nan, np.complex128), 0
        self._missed = np.zeros((2, n))  # squares of what it should have felt; by what it felt
        self.faults: Bytes = np.zeros(n, np.uint8)
        """(n_tactels,) :class:`TactelFault` bits, live."""
        self.is_withheld, self.is_repeated = np.zeros((2, m), np.bool_)
        """(n_patches,) whether the newest readings are of an earlier sample, or all at full scale; whether
        all have come again, and are withheld for it; live."""
        self.n_faulty: Ints = np.zeros(m, np.int64)
        """(n_patches,) tactels that have any, live."""
        self._last_ns: int | None = None

    def resume(self, patch: int, faults: Ints) -> None:
        """Begin with the faults (n_tactels of the patch,) that were found before; they heal as any others.

        What is out of its band the baseline finds anew.
        """
        here = self.arm.tactels_of(patch)
        self.faults[here] = np.where(self.arm.tactel_healthy[here], faults & JUDGED, 0)
        self.n_faulty[patch] = np.count_nonzero(self.faults[here])

    def judge(self, pressures: Floats, t_ns: int, fresh: Bools, baseline: Baseline) -> None:
        """Judge the readings of a cycle, and make those that are not plausible NaN, in place.

        Those that are only out of their band stay: the baseline needs them, and marks them itself.

        pressures: (n_tactels,) float64, Pa, calibrated, before any zero is subtracted; finite. Where they are
                   not fresh, the newest that came.
        fresh:     (n_patches,) False where readings are missing, or are not used.
        baseline:  as the last cycle has left it.
        """
        now_ns, patch, touched = check_time(t_ns), self._patch, baseline.felt.touched != 0
        dt = min(max(1e-9 * (now_ns - self._last_ns), 0.0), SETTLE_S) if self._last_ns is not None else 0.0
        change, felt = pressures - self._value, pressures - baseline.felt.zero
        self._last_ns, self._value = now_ns, pressures.copy()
        seen = fresh[patch] & self.arm.tactel_healthy & np.isfinite(pressures)
        still, n, same, rail_s, was_lone, jumps, good_s = self._state

        comes_again = seen & (change == 0.0)
        still = np.where(comes_again, still + 1.0, 0.0)
        shows = comes_again & (np.abs(pressures) < -self._low)
        shows &= same + 2.0 / np.sqrt(np.maximum(n, 1.0)) <= SHOWN
        chance = np.where(shows, np.log(np.maximum(same, self._most)), 0.0)
        begins = ~shows
        begins[self._first] = True
        run = begins.cumsum()
        is_old = shows & (np.bincount(run, chance * still)[run] < CHANCE)

        n_seen, is_top = self._by_patch(seen), seen & (pressures >= self._high)
        all_again = (self._by_patch(comes_again) == n_seen) & (self._by_patch(chance) < 2.0 * CHANCE)
        self.is_repeated[:] = fresh & all_again
        leaps = is_top & (change >= LEAP * self._high)
        is_full = self._is_full | (2 * self._by_patch(leaps) > n_seen)
        is_full &= (self._by_patch(is_top) == n_seen) & (n_seen >= LEAST_FULL)
        np.copyto(self._is_full, is_full, where=fresh)
        self.is_withheld[:] = fresh & (self._is_full | self.is_repeated)
        is_full = self._is_full[patch]

        free = seen & ~touched & (np.abs(felt) < 3.0 * self._sigma) & ~is_old & ~self.is_repeated[patch]
        n = np.minimum(n + free, FORGET_CYCLES)
        same = same + free * (comes_again - same) / np.maximum(n, 1.0)

        lone, (i,) = is_top & (was_lone > 0.0), np.nonzero(seen & ~is_full & (felt >= self._jump))
        if len(i):
            beside = np.where(self._is_next[:, i], felt[self._near[:, i]], 0.0).max(axis=0)
            for k in i[leaps[i] | (beside < LONE * felt[i])].tolist():
                lone[k] |= self._is_lone(k, felt) or (leaps[k] and self._is_lone(k, change))
        jumps = jumps * (1.0 - dt / FORGET_S) + (lone & (was_lone == 0.0))
        is_wrong = lone | is_full | (pressures <= self._low)
        rail_s = np.where(is_wrong, rail_s + min(dt, WRONG_S / WRONG_TIMES), 0.0)
        bad = RAIL * (rail_s >= WRONG_S) | JUMPING * (jumps >= WRONG_TIMES - 1)
        bad |= FROZEN * (chance * still < 6.0 * CHANCE)
        good_s = np.where(bad == 0, good_s + dt, 0.0)
        held = self.faults & np.where(good_s < SETTLE_S, JUDGED, DEAD)
        np.copyto(self._state, (still, n, same, rail_s, lone, jumps, good_s), where=seen)
        np.copyto(self.faults, held | bad | BAND * baseline.felt.out, "unsafe", where=seen)

        is_touched = fresh & (self._by_patch(touched) > 0)
        np.copyto(self._missed_at[1], self._missed_at[0], where=~is_touched[patch])
        if is_touched.any():
            self._find_dead(seen & is_touched[patch] & ~is_full, felt)
        self.n_faulty[:] = self._by_patch(self.faults != 0)
        # the baseline watches for a return to the band; what is not named yet is not used either
        unsure = (self.faults == 0) & (is_old | is_wrong)
        pressures[seen & ((self.faults & JUDGED != 0) | unsure)] = math.nan

    def _is_lone(self, k: int, felt: Floats) -> bool:
        """Return whether what a tactel reads is not explained by a contact anywhere around.

        A neighbour that reads more may feel another contact, and makes up for no other neighbour.
        """
        j, own = self._near[1:, k], self._law[self._row[0, k]]
        law = self._law[self._row[1:, k]] * (self.faults == 0)[j, None]
        peak = felt[k] / np.maximum(own, 1e-9)
        less = law * (LONE * peak * law - np.minimum(felt[j, None], peak * law))
        noise = self._sigma[k] * np.sqrt((law**2).sum(axis=0))
        return not (less.sum(axis=0) <= EXPLAINED * noise)[peak <= BEYOND * self._high[k]].any()

    def _find_dead(self, watched: Bools, felt: Floats) -> None:
        """Look at one silent tactel beside the strongest of its board."""
        feels = felt >= FEELS * self._sigma
        self._missed_at[:, watched & feels] = np.nan
        self.faults[watched & feels] &= JUDGED ^ DEAD | BAND
        usable = (self.faults == 0) & (self._value < self._high)
        top = np.maximum.reduceat(np.where(usable, felt, 0.0), self._first)[self._patch]
        (i,) = np.nonzero(watched & usable & (felt >= top))
        i = self._near[:, i][self._is_next[:, i]]
        i = i[(watched & usable & ~feels)[i]]
        if not len(i):
            return
        self._turn += 1
        k = int(i[self._turn % len(i)])
        # on a dead line the silence of others says nothing
        least, place = self._least(k, felt, usable) or self._least(k, felt, usable & feels) or (0.0, 0j)
        first, is_elsewhere = self._missed_at[1, k], abs(place - self._missed_at[1, k]) >= ELSEWHERE
        if least >= FEELS * self._sigma[k] and (np.isnan(first) or is_elsewhere):
            if np.isnan(self._missed_at[0, k]):
                self._missed_at[0, k], self._missed[:, k] = place, 0.0
            self._missed[:, k] += least * least, least * felt[k]
            due, shown = self._missed[:, k]
            if is_elsewhere and shown + 2.0 * self._sigma[k] * math.sqrt(due) < DEAD_SHARE * due:
                self.faults[k] |= DEAD

    def _least(self, k: int, felt: Floats, usable: Bools) -> tuple[float, complex] | None:
        """Return the least (Pa) that a tactel reads under a contact that explains its neighbours, and where.

        None if none does.
        """
        j = self._near[1:, k]
        told = (j >= 0) & usable[j]
        law, y = self._law[self._row[1:, k][told]], felt[j[told]]
        up, down = y @ law, np.einsum("ij,ij->j", law, law)
        peak = up / np.maximum(down, 1e-12)
        chi2 = np.where(peak <= BEYOND * self._high[k], y @ y - peak * up, np.inf)
        best, unit = chi2.argmin(), self._sigma[k] ** 2 + (TOLERANCE * y.max(initial=0.0)) ** 2
        if len(y) <= 3 or chi2[best] > len(y) * unit:  # a contact has three unknowns
            return None
        own = peak * self._law[self._row[0, k]]
        return float(own[chi2 <= chi2[best] + LIKELY * unit].min()), complex(PLACE[best])

    def _by_patch(self, column: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the sums of a column of tactels, (n_patches,)."""
        return np.bincount(self._patch, column, len(self._first))


AXIS = np.linspace(-SPAN, SPAN, PLACES)
PLACE = (AXIS + 1j * AXIS[:, None]).ravel()
"""u + jv of the places of a contact around a tactel, pitches."""


def _neighbours(arm: Arm) -> tuple[Ints, Ints, Floats, Bools]:
    """Return the neighbours of tactels, rows of the law for them, the law, and which are one step away.

    All but the law are (n, n_tactels), -1 for none, the nearest first: the tactel itself. The law (rows,
    places) is the part of its peak that a tactel feels of a contact of 1 N at a place around another. Boards
    of one law share rows; the last is 0, of none.
    """
    rows: dict[tuple[Law, float, complex], int] = {}
    near: Any = []
    row: Any = []
    for start, placed in zip(arm.patch_start, arm.patches, strict=False):
        law, pitch = placed.patch.law, placed.patch.pitch
        at = placed.patch.tactels_uv @ (1.0, 1j) / pitch
        for steps in np.round(at - at[:, None], 6):
            beside = np.argsort(np.abs(steps), kind="stable")
            beside = beside[np.abs(steps[beside]) <= REACH]
            near.append(start + beside)
            row.append([rows.setdefault((law, pitch, step), len(rows)) for step in steps[beside].tolist()])
    peaks = [
        law.pressure(pitch * np.abs(np.append(PLACE - step, 0.0)) / WIDTH, 1.0) for law, pitch, step in rows
    ]
    table = np.array([*(peak[:-1] / peak[-1] for peak in peaks), np.zeros(PLACES**2)])
    is_next = np.array([*(0.0 < abs(step) < NEXT for _, _, step in rows), False])
    near, row = (np.array([*zip_longest(*lists, fillvalue=-1)]) for lists in (near, row))
    return near, row, table, is_next[row]
