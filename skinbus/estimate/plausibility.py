"""Which tactels are plausible: what an implausible one reads is missing, not zero.

Rail:      at the lower end of the converter, and missing at once; alone at a pressure of which the law of the
           board, for a narrow contact anywhere around, gives its neighbours more than they read, and missing
           at once; or at full scale with its whole board, of which half was not near it before: the board is
           withheld at once. What came to full scale
           alone is missing until it leaves it, whatever touches beside it
Frozen:    not a bit changes, for a time in which it would have changed at the rate it did while free, if
           its noise is more than about half a step of its converter
Dead:      reads less than a tenth of the least that it should have felt in two touches in a row, in two
           places: every contact that explains its neighbours by the law of the board would press it. In each
           cycle of a touch one of the silent tactels is looked at
Jumping:   it begins to read alone what no contact explains, some five times in five seconds
Band:      below its zero band, or its zero has left it (``Baseline``)

Readings that come again bit by bit, although the noise of the tactel shows in others, are not those of a new
sample. As soon as that is too unlikely to be chance, of tactels that follow each other together, they are
missing; where they are all of the board, it is withheld (``is_withheld``), every time. Such runs teach no
rate of change.

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
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from skinbus.arrays import Bools, Bytes, Floats, Ints
from skinbus.estimate.baseline import Baseline
from skinbus.estimate.columns import record
from skinbus.estimate.kernels.layout import limit_of, step_of
from skinbus.jit import inner_kernel, kernel
from skinbus.model import Arm, Law
from skinbus.model.validation import check_arm, check_time

Singles = npt.NDArray[np.float32]
Rows = npt.NDArray[Any]

BAND, RAIL, FROZEN, DEAD, JUMPING = 1, 2, 4, 8, 16
JUDGED = RAIL | FROZEN | DEAD | JUMPING
"""What is found here; of its band the baseline knows."""


class TactelFault(IntFlag):
    """What is wrong with a tactel."""

    BAND = BAND
    """Reads below its zero band, or its zero has left the band."""
    RAIL = RAIL
    """At the lower end of the converter, or alone at a pressure that no contact explains."""
    FROZEN = FROZEN
    DEAD = DEAD
    JUMPING = JUMPING


RETURN_S = 1.0
"""A tactel that has been plausible for so long is used again, s."""

# --- Rails and jumps -------------------------------------------------------------------------------
BOTTOM = 0.95
"""Of full scale below zero: no healthy tactel reads so little."""
RAIL_S, RAIL_READINGS = 0.2, 5
"""At a rail for so long, and so many readings: within half a second at 10 Hz and more, and no bit error."""
LEAST_FULL = 4
"""Tactels of a board that all of them are: one contact may saturate fewer."""
CRUSHED = 0.5
"""Of full scale: a supply that fails comes from below it at once."""
JUMP_SHARE = 0.5
"""Of full scale: what comes there by more, and alone, is stuck."""
JUMPS, JUMPS_S = 4.0, 5.0
"""So many within so long, s: a bit error now and then is not a fault of the tactel."""
JUMP_SIGMAS = 12.0
"""A jump, in standard deviations of noise, and at least the touch threshold: twice what is a touch."""
UNMOVED = 2.5
"""Root mean square of the changes of readings beside a jump, in standard deviations of noise, that is none. A
tip of 2 mm with 1 N in the middle of a tactel changes the four beside it by 2 each."""
LONE = 0.2
"""Of what the narrowest contact gives the neighbours of a tactel they read at least this part: gains differ
by 10 %, and the skirt of a tip of 2 mm is half of what the law, made so narrow, says."""
LONE_SURE = 3.0
"""Standard deviations by which all neighbours together read less than that: what real contacts make them read
is 7 more, and once in a thousand cycles a tactel that only looks so is missing."""
BEYOND = 4.0
"""Highest peak of a contact beside a tactel that is considered, in full scales: 170 N on the usual board."""

# --- Readings that come again ----------------------------------------------------------------------
SHOWN = 0.45
"""Share of readings of a free tactel that come again, with four standard errors, below which noise shows at
every pressure. Noise of less than half a step repeats half of them where it is between two steps, and all in
the middle of one."""
FORGET_CYCLES = 2000
"""It is that of the last so many cycles."""
SUSPECT = math.log(1e-5)
"""Chance of repetitions of tactels in a row to be new samples, below which they are missing."""
REPEAT_CHANCE = math.log(1e-9)
"""The same of a whole board: once in eleven days at 1 kHz."""
CHANCE = 2.0 * math.log(1e-15)
"""Of one run of readings to call a healthy tactel frozen: 400 tactels at 1 kHz have 10^13 runs in a year. It
counts twice: a pressed reading may lie in the middle of a step, where it changes less often."""

# --- Dead tactels ----------------------------------------------------------------------------------
REACH, NEXT = 2.3, 1.5
"""Pitches within which tactels of a board are neighbours: two steps on a square, but for the corners; and
within which they are next to each other."""
PLACES, SPAN = 17, 1.75
"""Places of a contact that are tried along each axis, and how far they reach, in pitches. Any contact that is
felt beside a tactel, but not by it, is among them, and a reading changes by no more than the law's error from
one to the next."""
IN_LINE = 0.25
"""Pitches off a line by which a tactel is in it."""
STEP = 2.0 * SPAN / (PLACES - 1)
LIGHT_N = 1.0
"""Force by whose law a reading is judged beside others, N."""
WIDTH = 0.92
"""Of the narrowest contact, a tip of 2 mm, part of that of the law."""
CLEAR = 5.0
"""Standard deviations of noise: a prediction below proves nothing by its absence."""
LIKELY, MISFIT, TOLERANCE = 6.0, 1.0, 0.1
"""chi^2 within which another place explains the neighbours too; chi^2 of each neighbour beyond which none
does; the law's error, part of the peak."""
EVIDENT_TOUCHES, ELSEWHERE = 2, 0.35
"""Touches in a row that a dead tactel should have felt, and pitches from the first: that may be two contacts
that look like one, and press the same place again and again."""
DEAD_SHARE, SURE = 0.1, 2.0
"""A dead tactel reads less than this part of the least it should have, by so many standard deviations: beside
a tip of 2 mm, for which the law is too wide, a healthy one may read a tenth."""
FEELS = 6.0
"""Standard deviations from which a tactel feels something, and half of its threshold: it is not dead."""

TACTEL = record(
    {
        "f8": "high low sigma touch quiet value change felt cycles changes jumps good_s due shown",
        "i8": "first last still rail_n lone_n touches first_cell",
        "b1": "healthy is_old was_old evident",
        "u1": "fault",
    }
)
"""high, low    Pa, full scale and the lower end
sigma, touch Pa, noise with the rounding of the counts; threshold
first, last  range of its neighbours
quiet        log of the largest chance of a reading to come again, by the declared noise
value        Pa, the newest reading; its change since the one before; what is felt of it, less the zero
still        readings in a row without change; is_old: too unlikely to be new; was_old: some of this run was
cycles, changes while free
rail_n, lone_n readings in a row at a rail or alone; alone
jumps        times that it began to be alone, of late
good_s       since it was implausible last
evident      it should have felt something in this touch; touches: in a row of which it felt nothing
due, shown   sums in noise: of the square of what it should have read at least; times what it read
first_cell   place of the first touch that it should have felt
"""
BOARD = record(
    {
        "i8": "start stop own_row turn n_faulty",
        "f8": "quiet_s",
        "b1": "is_full is_crushed is_repeated is_withheld",
    }
)
"""start, stop  range of its tactels
own_row      row of ``law`` of a tactel itself
turn         the tactel that was looked at last
quiet_s      since the board was touched
is_full      all readings are at full scale, and came there at once; is_crushed: half were near it before
is_repeated  its readings are too unlikely to be new; is_withheld: that, or full
"""
BESIDE = record({"i8": "tactel row line", "b1": "is_next"})
"""A neighbour of a tactel, its row of ``law``, whether it is one step away, diagonals too, and whether it is
in line with the tactel along v (1), along u (2) or not (0)."""


class _Skin(NamedTuple):
    """The state by which the tactels of an arm are judged."""

    tactels: Rows
    boards: Rows
    beside: Rows
    law: Singles
    """(rows, places) part of its peak that a tactel or a neighbour feels of a light contact at a place."""
    scratch: Floats


class Plausibility:
    """Judges the readings of an arm, cycle by cycle."""

    def __init__(self, arm: Arm) -> None:
        check_arm(arm)
        self.arm = arm
        tactels, boards = _tactels(arm), np.zeros(arm.n_patches, BOARD)
        boards["start"], boards["stop"] = arm.patch_start[:-1], arm.patch_start[1:]
        self._skin = _Skin(tactels, boards, *_neighbours(arm, tactels, boards), np.zeros((2, PLACES**2)))
        self.faults: Bytes = tactels["fault"]
        """(n_tactels,) :class:`TactelFault` bits, live."""
        self.is_withheld: Bools = boards["is_withheld"]
        """(n_patches,) whether the newest readings are of an earlier sample, or all at full scale, live."""
        self.is_repeated: Bools = boards["is_repeated"]
        """(n_patches,) whether all readings of this cycle have come again and are withheld for it, live."""
        self.n_faulty: Ints = boards["n_faulty"]
        """(n_patches,) tactels that have any, live."""
        self._last_ns: int | None = None
        none = np.zeros(arm.n_patches, np.bool_)
        self.judge(np.zeros(arm.n_tactels), 0, none, Baseline(arm))  # compiled now
        self._last_ns = None

    def resume(self, patch: int, faults: Ints) -> None:
        """Begin with the faults (n_tactels of the patch,) that were found before; they heal as any others.

        What is out of its band the baseline finds anew.
        """
        t = self._skin.tactels[self.arm.tactels_of(patch)]
        t["fault"] = np.where(t["healthy"], faults & JUDGED, 0)
        self.n_faulty[patch] = np.count_nonzero(t["fault"])

    def judge(self, pressures: Floats, t_ns: int, fresh: Bools, baseline: Baseline) -> None:
        """Judge the readings of a cycle, and make those that are not plausible NaN, in place.

        Those that are only out of their band stay: the baseline needs them, and marks them itself.

        pressures: (n_tactels,) float64, Pa, calibrated, before any zero is subtracted; finite. Where they are
                   not fresh, the newest that came.
        fresh:     (n_patches,) False where readings are missing, or are not used.
        baseline:  as the last cycle has left it.
        """
        now_ns = check_time(t_ns)
        dt = min(max(1e-9 * (now_ns - self._last_ns), 0.0), 1.0) if self._last_ns is not None else 0.0
        self._last_ns, felt = now_ns, baseline.felt
        _judge(self._skin, pressures, felt.zero, felt.touched, felt.out, fresh, dt)


def _tactels(arm: Arm) -> Rows:
    """Return the tactels of an arm before their first reading."""
    tactels, step = np.zeros(arm.n_tactels, TACTEL), step_of(arm)
    tactels["healthy"], tactels["high"], tactels["touch"] = (
        arm.tactel_healthy,
        limit_of(arm),
        arm.tactel_threshold,
    )
    tactels["low"] = -BOTTOM * tactels["high"]
    tactels["sigma"] = np.maximum(np.sqrt(arm.tactel_noise**2 + step**2 / 12.0), 1e-3)
    # the mean in the middle of a step
    most = erf(step / (np.sqrt(8.0) * np.maximum(arm.tactel_noise, 1e-300)))
    tactels["quiet"] = np.log(np.where(step > 0.0, most, 1.0))
    return tactels


def _neighbours(arm: Arm, tactels: Rows, boards: Rows) -> tuple[Rows, Singles]:
    """Return the neighbours of tactels and ``law``, (rows, places); boards of one law share rows.

    It is the part of its peak that a tactel or a neighbour feels of a light contact at a place; of a cone,
    the narrowest it makes.
    """
    axis = np.linspace(-SPAN, SPAN, PLACES)
    places = (axis + 1j * axis[:, None]).ravel()
    rows: dict[tuple[Law, float, complex], int] = {}
    beside: list[tuple[int, int, int, bool]] = []
    for p, placed in enumerate(arm.patches):
        law, pitch, start = placed.patch.law, placed.patch.pitch, arm.patch_start[p]
        at = placed.patch.tactels_uv @ (1.0, 1j) / pitch
        for i, own in enumerate(at):
            tactels["first"][start + i] = len(beside)
            for j in np.flatnonzero(np.abs(at - own) <= REACH).tolist():
                step = complex(np.round(at[j] - own, 6))
                row = rows.setdefault((law, pitch, step), len(rows))
                line = (abs(step.real) < IN_LINE) + 2 * (abs(step.imag) < IN_LINE)
                if j != i:
                    beside.append((start + j, row, line, abs(step) < NEXT))
            tactels["last"][start + i] = len(beside)
        boards["own_row"][p] = rows[law, pitch, 0j]
    peaks = [
        law.pressure(pitch * np.abs(np.append(places - step, 0.0)) / WIDTH, LIGHT_N)
        for law, pitch, step in rows
    ]
    return np.array(beside, BESIDE), np.array([peak[:-1] / peak[-1] for peak in peaks], np.float32)


@kernel
def _judge(
    skin: _Skin,
    pressures: Floats,
    zero: Floats,
    touched: npt.NDArray[np.int8],
    out: Bools,
    fresh: Bools,
    dt: float,
) -> None:
    """Run one cycle."""
    for p in range(len(skin.boards)):
        b = skin.boards[p]
        b.is_withheld = b.is_repeated = False
        if not fresh[p]:
            for i in range(b.start, b.stop):
                skin.tactels[i].value = pressures[i]  # it may come again once the board is used
            continue
        is_touched = False
        for i in range(b.start, b.stop):
            t = skin.tactels[i]
            t.change, t.value, t.felt = pressures[i] - t.value, pressures[i], pressures[i] - zero[i]
            is_touched |= touched[i] != 0
        _compare(skin, b)
        b.quiet_s = 0.0 if is_touched else b.quiet_s + dt
        if b.quiet_s > RAIL_S:
            _end_touch(skin, b)
        is_touched &= not b.is_full
        for i in range(b.start, b.stop):
            t = skin.tactels[i]
            if t.healthy and math.isfinite(t.value):
                bad = _rail(skin, b, t, dt)
                is_free = touched[i] == 0 and abs(t.felt) < 3.0 * t.sigma
                bad |= _changes(b, t, is_free)
                t.good_s = 0.0 if bad != 0 else t.good_s + dt
                held = t.fault & (JUDGED if t.good_s < RETURN_S else DEAD)
                t.fault = held | bad | (BAND if out[i] else 0)
                if is_touched and t.felt >= FEELS * t.sigma and t.felt >= 0.5 * t.touch:
                    t.evident, t.touches, t.due, t.shown = False, 0, 0.0, 0.0
                    t.fault &= JUDGED ^ DEAD | BAND
        if is_touched:
            _watch_touch(skin, b)
        b.n_faulty = 0
        for i in range(b.start, b.stop):
            t = skin.tactels[i]
            b.n_faulty += t.fault != 0
            # the baseline watches for a return to the band; what is not named yet is not used either
            if t.fault & JUDGED != 0 or (t.fault == 0 and (t.is_old or t.rail_n > 0)):
                pressures[i] = math.nan


@inner_kernel
def _compare(skin: _Skin, b: Any) -> None:
    """Compare the readings of a board with those before, and with full scale.

    Repetitions of tactels that follow each other count together: those of a PDO come again together.
    """
    n, n_same, n_hard, n_full = 0, 0, 0, 0
    begin, run, chance = b.start, 0.0, 0.0
    for i in range(b.start, b.stop):
        t, own = skin.tactels[i], 0.0
        t.is_old &= t.change == 0.0
        if t.healthy and math.isfinite(t.value):
            n += 1
            n_hard += t.value >= CRUSHED * t.high
            n_full += t.value >= t.high
            if t.change == 0.0:
                n_same += 1
                t.still += 1
                own = _log_same(t)
        chance += own
        run += own * t.still
        if own == 0.0:
            begin, run = i + 1, 0.0
        elif run + math.log(b.stop - b.start) * (i > begin) < SUSPECT:
            for j in range(begin, i + 1):
                skin.tactels[j].is_old = True
    is_full = n_full == n >= LEAST_FULL  # its supply fails, or force has brought it there
    if not is_full:
        b.is_crushed = 2 * n_hard >= n > 0
    b.is_full = is_full and not b.is_crushed
    b.is_repeated = n_same == n and chance < REPEAT_CHANCE
    b.is_withheld = b.is_full or b.is_repeated


@inner_kernel
def _log_same(t: Any) -> float:
    """Return the log of the chance of a reading to come again; 0 where that is not known, and at a rail."""
    same = 1.0 - t.changes / (t.cycles + 1.0)
    if same + 2.0 / math.sqrt(t.cycles) > SHOWN or not t.low < t.value < t.high:
        return 0.0
    return float(max(t.quiet, math.log(same)))


@inner_kernel
def _rail(skin: _Skin, b: Any, t: Any, dt: float) -> int:
    """Return whether a tactel is at a rail, or reads alone what no contact explains, again and again."""
    is_at_top, is_lone, before = t.value >= t.high, False, t.lone_n
    if not b.is_full:
        if is_at_top and t.change >= JUMP_SHARE * t.high and _jumps_alone(skin, t):
            t.lone_n = RAIL_READINGS  # whatever touches beside it later
        # what came to full scale alone is stuck until it leaves it
        is_lone = (is_at_top and t.lone_n >= RAIL_READINGS) or _is_alone(skin, b, t)
    t.lone_n = t.lone_n + 1 if is_lone else 0
    t.jumps -= t.jumps * min(dt / JUMPS_S, 1.0)
    t.jumps += is_lone and before == 0
    t.rail_n = t.rail_n + 1 if is_lone or t.value <= t.low or b.is_full else 0
    bad = RAIL if t.rail_n >= RAIL_READINGS and t.rail_n * dt >= RAIL_S else 0
    return bad | JUMPING if t.jumps >= JUMPS else bad


@inner_kernel
def _is_alone(skin: _Skin, b: Any, t: Any) -> bool:
    """Return whether a tactel reads what no contact around explains: its neighbours would read more."""
    if t.felt < max(t.touch, JUMP_SIGMAS * t.sigma):
        return False
    n_cells = skin.law.shape[1]
    for k in range(n_cells):
        cell = (n_cells // 2 + k) % n_cells  # from the middle on: that explains most
        peak = t.felt / max(skin.law[b.own_row, cell], 1e-9)
        if peak > BEYOND * t.high:
            continue
        less, square, n = 0.0, 0.0, 0
        for e in range(t.first, t.last):
            near = skin.beside[e]
            other = skin.tactels[near.tactel]
            if other.fault == 0 and math.isfinite(other.value):
                due = peak * skin.law[near.row, cell]
                # what is more than the law may be of another contact, and makes up for no other neighbour
                less += due * (LONE * due - min(max(other.felt, 0.0), due))
                square += (due * other.sigma) ** 2
                n += 1
        if n < 2 or square == 0.0 or less < LONE_SURE * math.sqrt(square):
            return False
    return True


@inner_kernel
def _jumps_alone(skin: _Skin, t: Any) -> bool:
    """Return whether the nearest neighbours of a tactel stay as they were while it changes.

    A tap changes them too, however narrow and short it is.
    """
    n, square, variance = 0, 0.0, 0.0
    for e in range(t.first, t.last):
        near = skin.beside[e]
        other = skin.tactels[near.tactel]
        if other.fault == 0 and near.is_next and math.isfinite(other.change):
            n += 1
            square += other.change * other.change
            variance += 2.0 * other.sigma * other.sigma
    return n >= 2 and square < UNMOVED * UNMOVED * variance


@inner_kernel
def _changes(b: Any, t: Any, is_free: bool) -> int:
    """Return whether a tactel is frozen; learn how often a free one repeats."""
    if t.change == 0.0:
        t.was_old |= t.is_old or b.is_repeated or not t.low < t.value < t.high
        return FROZEN if t.still * _log_same(t) < CHANCE else 0
    # a run counts when it is over, and if all of it was new: a frozen one does not change the rate
    if is_free and not t.was_old:
        keep = 0.5 if t.cycles > FORGET_CYCLES else 1.0
        t.cycles = keep * (t.cycles + t.still + 1.0)
        t.changes = keep * (t.changes + 1.0)
    t.still = 0
    t.was_old = False
    return 0


@inner_kernel
def _watch_touch(skin: _Skin, b: Any) -> None:
    """Look at one of the silent tactels of a touched board."""
    for _ in range(b.stop - b.start):
        b.turn = b.turn + 1 if b.start <= b.turn < b.stop - 1 else b.start
        t = skin.tactels[b.turn]
        if t.healthy and math.isfinite(t.value) and t.felt < FEELS * t.sigma and _is_due(skin, b, t):
            return


@inner_kernel
def _is_due(skin: _Skin, b: Any, t: Any) -> bool:
    """Note what a silent tactel should have read; return False if too little is felt beside it."""
    n_felt = 0
    for e in range(t.first, t.last):
        near = skin.beside[e]
        other = skin.tactels[near.tactel]
        n_felt += near.is_next and other.felt >= CLEAR * other.sigma
    if n_felt < 2:
        return False
    least, place = 0.0, 0
    for dead in range(3):  # a line is dead with its wire
        if least == 0.0:
            least, place = _least_felt(skin, b, t, dead)
    if t.touches == 0 and not t.evident:
        t.first_cell = place
    u = place % PLACES - t.first_cell % PLACES
    v = place // PLACES - t.first_cell // PLACES
    # the first touch that it has not felt may be two contacts that look like one, and come again and again
    is_elsewhere = STEP * math.sqrt(u * u + v * v) >= ELSEWHERE or t.touches == 0
    if least > CLEAR * t.sigma and is_elsewhere:
        least /= t.sigma
        t.due += least * least
        t.shown += least * t.felt / t.sigma
        t.evident = True
    return True


@inner_kernel
def _least_felt(skin: _Skin, b: Any, t: Any, dead: int) -> tuple[float, int]:
    """Return the least (Pa) that a tactel reads under a contact that explains its neighbours, and its place.

    dead: the ``line`` whose tactels count as missing where they read nothing

    Of the places of a contact those with a chi^2 of at most LIKELY more than the best explain the neighbours,
    if that of the best is at most MISFIT each. 0 if none does, or the board reads more elsewhere.
    """
    n, top, square = 0, 0.0, 0.0
    up, down, n_cells = skin.scratch[0], skin.scratch[1], skin.law.shape[1]
    for cell in range(n_cells):
        up[cell] = down[cell] = 0.0
    for e in range(t.first, t.last):
        near = skin.beside[e]
        other, row = skin.tactels[near.tactel], near.row
        is_lost = dead & near.line != 0 and other.felt < CLEAR * t.sigma
        if other.fault == 0 and other.value < other.high and not is_lost:
            n += 1
            top = max(top, other.felt)
            square += other.felt * other.felt
            for cell in range(n_cells):
                part = skin.law[row, cell]
                up[cell] += part * other.felt
                down[cell] += part * part
    for i in range(b.start, b.stop):
        if n < 4 or (skin.tactels[i].fault == 0 and skin.tactels[i].felt > top):
            return 0.0, 0
    best, place = math.inf, 0
    for cell in range(n_cells):
        amplitude = up[cell] / down[cell] if down[cell] > 0.0 else 0.0
        up[cell] = square - amplitude * up[cell] if amplitude <= BEYOND * t.high else math.inf
        down[cell] = amplitude * skin.law[b.own_row, cell]
        if up[cell] < best:
            best, place = up[cell], cell
    unit = t.sigma**2 + (TOLERANCE * top) ** 2
    least = math.inf if best <= MISFIT * n * unit else 0.0
    for cell in range(n_cells):
        if up[cell] <= best + LIKELY * unit:
            least = min(least, down[cell])
    return least, place


@inner_kernel
def _end_touch(skin: _Skin, b: Any) -> None:
    """Name the tactels of a board that read too little of what they should have in some touches."""
    for i in range(b.start, b.stop):
        t = skin.tactels[i]
        if t.evident:
            t.evident = False
            t.touches += 1
            is_silent = t.shown + SURE * math.sqrt(t.due) < DEAD_SHARE * t.due
            if is_silent and t.touches >= EVIDENT_TOUCHES:
                t.fault |= DEAD
