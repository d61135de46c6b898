"""One cycle of the judgement of tactels: rails, frozen, dead and jumping ones.

:mod:`skinbus.estimate.plausibility` says by which rules.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.judged_columns import Columns
from skinbus.estimate.kernels.silence import (
    DEAD,
    JUMP_SIGMAS,
    came_alone,
    end_touch,
    is_alone,
    is_lone_at_full_scale,
    jumps_alone,
    note_life,
    watch_touch,
)
from skinbus.jit import inner_kernel, kernel

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

BAND, RAIL, FROZEN, JUMPING = 1, 2, 4, 16
"""Bits of ``plausibility.TactelFault``."""
RETURN_S: Final = 1.0
"""A tactel that has been plausible for so long is used again, s."""
RAIL_S, RAIL_READINGS = 0.2, 5
"""At a rail for so long, and so many readings: within half a second at 10 Hz and more, and no bit error."""
LEAST_CHANGES: Final = 100
"""Changes of a free tactel before its rate of change is used."""
CHANCE: Final = math.log(1e-15)
"""Of one run of readings to call a healthy tactel frozen: 400 tactels at 1 kHz have 10^13 runs in a year."""
FREEZE_LEAST: Final = 20
"""Readings: no run shorter than this is frozen."""
FREEZE_MARGIN: Final = 2.0
"""On the length of the run: a pressed reading may lie in the middle of a step of the converter, where it
changes less often."""
FORGET_CYCLES: Final = 2000
"""The rate of change is that of the last so many cycles."""
SHORT_RUN: Final = 4
"""Cycles in a row in which a whole board repeated, at most, that say nothing of the noise of its tactels: its
converter is slower than the SYNC. Without noise it repeats for longer."""
NOISE_CHANGE: Final = 6.0
"""Standard deviations of noise that a reading changes by without a touch, at most. A board changes by noise
if a fifth of what changes goes up, a fifth down, and a third otherwise than before: of white noise two
thirds do, of what a touch moves hardly any."""
NOISE2_GAIN: Final = 0.05
"""Of the newest change in the mean square: twenty changes. It counts as twice the usual at most: a touch
comes among them now and then."""
NOISE_CHANGES: Final = 40
"""Changes by noise that are counted: each other change takes two of them off."""
SLOW_CHANGES: Final = 8
"""Changes of a board by noise, each after repetitions of all of it, after which it takes samples at a lower
rate than the SYNC."""
PAUSE_CYCLES: Final = 1
"""Cycles in which nothing new came of a board, after which its next readings may be as old: they are
compared, and not used. A cycle that lost some of its frames is none of these."""
ONSET_CYCLES: Final = 3
"""Cycles between two readings used in which a touch does not come and change its neighbours for good."""
LEAST_FULL: Final = 4
"""Tactels of a board that all of them are: one contact may saturate fewer."""
CRUSHED: Final = 0.5
"""Of full scale: a supply that fails comes from below it at once."""
LONGEST_RUN: Final = 32
"""Readings of a tactel, whose noise shows, that are too many to come again by chance, at most."""
JUMP_CYCLES: Final = 3
"""Cycles in which a jump comes back."""
JUMPS, JUMPS_S = 5.0, 5.0
"""So many within so long, s: a bit error now and then is not a fault of the tactel."""
REPEAT_CHANCE: Final = math.log(1e-9)
"""Of readings of several tactels to come again bit by bit, below which they are no new sample: once in eleven
days of a board at 1 kHz, and such a reading is missing, not a fault."""
SHOWN, SHOWN_ERRORS = 0.45, 4.0
"""Share of readings of a free tactel that come again, so many standard errors added, below which its noise
shows at every pressure; 22 readings are enough. Noise of less than half a step repeats half of them where it
is between two steps, and all in the middle of one."""
NOISE_SHOWS: Final = 8
"""Changes by noise after which noise shows on a board: without it boards touched alike read alike."""
WIDE: Final = 8.0
"""Changes of so many steps are no noise of less than a step; that repeats one time in ten."""
MIX, MORE = 6364136223846793005, 1442695040888963407
"""Of a linear congruential generator modulo 2^64 (Knuth, MMIX): 126 boards have equal codes by chance once in
10^15 cycles."""
SUSPECT: Final = math.log(1e-5)
"""Of repetitions of one tactel, or of some that follow each other, to be new samples, below which they are
missing. One cycle in 10 000 of a contact of ten tactels is IMPAIRED by it, and a tactel whose noise is 20
counts is missing after three repetitions."""
MOST_JUMPS: Final = 7.0
"""Jumps that are counted: a tactel that has ceased to jump is plausible four seconds later."""


@kernel
def judge(
    w: Columns,
    pressures: Floats,
    zero: Floats,
    touched: npt.NDArray[np.int8],
    out: Bools,
    fresh: Bools,
    dt: float,
) -> None:
    """Run one cycle."""
    find_copies(w, pressures, fresh)
    for p in range(len(fresh)):
        i0, i1 = w.start[p], w.start[p + 1]
        _watch_full_scale(w, p, pressures, zero, fresh[p])
        if not fresh[p]:
            _note_unused(w, p, pressures)
            continue
        _judge_board(w, p, pressures, zero)
        any_touched = False
        for i in range(i0, i1):
            any_touched |= touched[i] != 0
        if any_touched:
            w.quiet_s[p] = 0.0
        elif w.quiet_s[p] <= RAIL_S:
            w.quiet_s[p] += dt
            if w.quiet_s[p] > RAIL_S:
                end_touch(w, p)
        n_faulty = 0
        for i in range(i0, i1):
            w.change[i] = pressures[i] - w.last[i] if math.isfinite(w.last[i]) else 0.0
        for i in range(i0, i1):
            if not (w.healthy[i] and math.isfinite(pressures[i])):
                continue
            w.alone[i] = w.is_stuck[i] or (not w.is_full[p] and is_alone(w, p, i, pressures, zero))
            at_rail = w.is_full[p] or w.alone[i] or is_lone_at_full_scale(w, p, i, pressures, zero)
            bad = _judge_alone(w, i, pressures[i], zero[i], touched[i] == 0, out[i], at_rail, dt)
            bad |= _judge_beside(w, i, pressures, zero, any_touched and not w.is_full[p], dt)
            held = w.fault[i] & ~BAND  # of its band the baseline says when it is over
            if bad & ~BAND != 0:
                w.good_s[i] = 0.0
            elif held != 0:
                w.good_s[i] += dt
                if w.good_s[i] >= RETURN_S:
                    held &= DEAD
            w.fault[i] = held | bad
        n_frozen = 0
        for i in range(i0, i1):
            n_frozen += 1 if w.fault[i] & FROZEN != 0 else 0
        if 2 * n_frozen >= i1 - i0:  # what its tactels have in common has stopped
            for i in range(i0, i1):
                if w.healthy[i] and w.still[i] >= FREEZE_LEAST:
                    w.fault[i] |= FROZEN
        watch_touch(w, p, pressures, zero, any_touched and not w.is_full[p])
        for i in range(i0, i1):
            if w.fault[i] != 0:
                n_faulty += 1
                if w.fault[i] != BAND:  # the baseline watches for its return to the band
                    pressures[i] = math.nan
            elif (
                w.alone[i]
                or pressures[i] <= w.low[i]
                or w.run_chance[i] < SUSPECT
                or (w.log_chance[i] < 0.0 and w.still[i] >= w.longest[p] > 0)
            ):
                pressures[i] = math.nan  # not named yet, and not used
        w.n_faulty[p] = n_faulty


@inner_kernel
def _note_unused(w: Columns, p: int, pressures: Floats) -> None:
    """Note what came from a board and is not used: it shows whether the board still takes samples."""
    is_new = False
    for i in range(w.start[p], w.start[p + 1]):
        if pressures[i] != w.newest[i]:
            is_new |= math.isfinite(w.newest[i])
            w.newest[i] = pressures[i]
            w.still[i] = w.apart[i] = 0
            w.is_old[i] = False
            w.run_chance[i] = 0.0
    w.pause[p] = 0 if is_new else w.pause[p] + 1
    w.n_unused[p] += 1


@inner_kernel
def _watch_full_scale(w: Columns, p: int, pressures: Floats, zero: Floats, fresh: bool) -> None:
    """Note which tactels came to full scale alone, and are still there: touches may come beside them."""
    for i in range(w.start[p], w.start[p + 1]):
        if pressures[i] < w.high[i] or not w.healthy[i]:
            w.is_stuck[i] = False
            w.lone_n[i] = 0
            continue
        if w.is_stuck[i] or not math.isfinite(pressures[i]):
            continue
        is_lone_now = is_alone(w, p, i, pressures, zero) or is_lone_at_full_scale(w, p, i, pressures, zero)
        w.lone_n[i] = w.lone_n[i] + 1 if is_lone_now else 0
        came = fresh and w.n_unused[p] < ONSET_CYCLES and came_alone(w, p, i, pressures)
        w.is_stuck[i] = came or w.lone_n[i] >= RAIL_READINGS


@inner_kernel
def _judge_board(w: Columns, p: int, pressures: Floats, zero: Floats) -> None:
    """Note which readings of a board come again bit by bit, and are together too unlikely to be new.

    Those that have come again ``longest`` times or more are no new samples: the chance that k of n tactels
    do so is the product over them, times the number of ways to choose them.
    """
    n_read, n_hard, n_full = _count_pressed(w, p, pressures)
    is_full = n_full == n_read >= LEAST_FULL  # which no law explains: its supply fails
    if not is_full:
        w.is_crushed[p] = 2 * n_hard >= n_read > 0  # force may bring it to full scale
    w.is_full[p] = is_full and not w.is_crushed[p]
    n, n_same, most = 0, 0, 0
    n_moved, n_up, n_back = 0, 0, 0
    for i in range(w.start[p], w.start[p + 1]):
        w.log_chance[i] = 0.0
        if not (w.healthy[i] and math.isfinite(pressures[i])):
            continue
        n += 1
        if pressures[i] == w.newest[i]:
            n_same += 1
            if w.low[i] < pressures[i] < w.high[i]:
                w.log_chance[i] = log_chance(w, p, i)
                if w.log_chance[i] < 0.0:
                    most = max(most, w.still[i] + 1)
        elif abs(pressures[i] - w.newest[i]) < NOISE_CHANGE * w.sigma[i]:
            goes_up = pressures[i] > w.newest[i]
            n_up += 1 if goes_up else 0
            n_back += 1 if goes_up != w.went_up[i] else 0
            n_moved += 1
            w.went_up[i] = goes_up
    w.longest[p] = 0
    for m in range(1, min(most, LONGEST_RUN) + 1):
        chance, k = 0.0, 0
        for i in range(w.start[p], w.start[p + 1]):
            if w.log_chance[i] < 0.0 and w.still[i] + 1 >= m:
                chance += w.log_chance[i]
                k += 1
        ways = math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0)
        if m * chance + ways < REPEAT_CHANCE:
            w.longest[p] = m
            break
    is_repeated = n_same == n >= LEAST_FULL
    if not is_repeated:
        least = 5 * min(n_up, n_moved - n_up)
        by_noise = least >= n_moved > 2 and 3 * n_back >= n_moved
        w.noise_n[p] = min(w.noise_n[p] + 1, NOISE_CHANGES) if by_noise else max(w.noise_n[p] - 2, 0)
        if w.same[p] == 0:
            w.slow_n[p] = 0
        elif by_noise and least >= n:
            w.slow_n[p] += 1
    is_old = n_same == n and (w.longest[p] > 0 or w.slow_n[p] >= SLOW_CHANGES)
    w.is_withheld[p] = w.is_full[p] or w.pause[p] >= PAUSE_CYCLES or is_old or w.is_copied[p]
    apart = w.same[p] if w.same[p] <= SHORT_RUN and not is_repeated else 0
    w.same[p] = w.same[p] + 1 if is_repeated else 0
    for i in range(w.start[p], w.start[p + 1]):
        w.apart[i] += apart
        if pressures[i] != w.newest[i]:
            w.run_chance[i] = 0.0
            continue
        if w.low[i] < pressures[i] < w.high[i]:
            w.is_old[i] |= w.log_chance[i] < 0.0 and w.still[i] + 1 >= w.longest[p] > 0
        else:
            w.is_old[i] = True  # at a rail it cannot change: that is no rate
        w.run_chance[i] += w.log_chance[i]
    if n_same > 0:
        _join_runs(w, p)
    w.pause[p] = w.n_unused[p] = 0


@inner_kernel
def _join_runs(w: Columns, p: int) -> None:
    """Take repetitions of tactels that follow each other as one: those of a PDO come together.

    What is missing teaches no rate of change.
    """
    begin, chance, size = w.start[p], 0.0, w.start[p + 1] - w.start[p]
    for i in range(w.start[p], w.start[p + 1] + 1):
        if i < w.start[p + 1] and w.log_chance[i] < 0.0:
            chance += w.run_chance[i]
            continue
        if i - begin > 1 and chance + math.log(size) < SUSPECT:
            for j in range(begin, i):
                w.run_chance[j] = min(w.run_chance[j], chance)
        begin, chance = i + 1, 0.0
    for i in range(w.start[p], w.start[p + 1]):
        w.is_old[i] |= w.run_chance[i] < SUSPECT


@inner_kernel
def _count_pressed(w: Columns, p: int, pressures: Floats) -> tuple[int, int, int]:
    """Return how many tactels of a board have a reading, are pressed hard, and are at full scale."""
    n, n_hard, n_full = 0, 0, 0
    for i in range(w.start[p], w.start[p + 1]):
        if w.healthy[i] and math.isfinite(pressures[i]):
            n += 1
            n_hard += 1 if pressures[i] >= CRUSHED * w.high[i] else 0
            n_full += 1 if pressures[i] >= w.high[i] else 0
    return n, n_hard, n_full


@inner_kernel
def _judge_alone(
    w: Columns, i: int, p: float, zero: float, free: bool, out: bool, at_rail: bool, dt: float
) -> int:
    """Return what the readings of a tactel say of it by themselves."""
    bad = BAND if out else 0
    if p <= w.low[i] or at_rail:
        w.rail_n[i] += 1
        w.rail_s[i] += dt
        if w.rail_n[i] >= RAIL_READINGS and w.rail_s[i] >= RAIL_S:
            bad |= RAIL
    else:
        w.rail_n[i] = 0
        w.rail_s[i] = 0.0
    if p == w.newest[i]:
        w.still[i] += 1
        if w.still[i] >= FREEZE_LEAST and p < w.high[i] and _is_frozen(w, i):
            bad |= FROZEN
        return bad
    # a run counts when it is over, and if all of it was new: a frozen one does not change the rate
    if free and abs(p - zero) < 3.0 * w.sigma[i] and w.still[i] < FORGET_CYCLES and not w.is_old[i]:
        most = 4.0 * max(w.noise2[i], w.step[i] ** 2)
        w.noise2[i] += NOISE2_GAIN * (min(w.change[i] ** 2, most) - w.noise2[i])
        w.cycles[i] += max(w.still[i] - w.apart[i], 0) + 1.0
        w.changes[i] += 1.0
        if w.cycles[i] > FORGET_CYCLES:
            w.cycles[i] *= 0.5
            w.changes[i] *= 0.5
    w.still[i] = w.apart[i] = 0
    w.is_old[i] = False
    return bad


@inner_kernel
def _is_frozen(w: Columns, i: int) -> bool:
    """Return whether a tactel has not changed for longer than chance allows."""
    if w.changes[i] < LEAST_CHANGES:
        return False
    same = min(max(1.0 - w.changes[i] / w.cycles[i], 0.05), 0.999)
    return bool(w.still[i] * math.log(same) < FREEZE_MARGIN * CHANCE)


@inner_kernel
def _judge_beside(w: Columns, i: int, pressures: Floats, zero: Floats, on_board: bool, dt: float) -> int:
    """Return what the readings of a tactel say of it beside those of its neighbours."""
    bad = 0
    p, last = pressures[i], w.last[i]
    w.last[i] = w.newest[i] = p
    limit = max(w.touch[i], JUMP_SIGMAS * w.sigma[i])
    w.jump_age[i] += 1
    w.jumps[i] -= w.jumps[i] * min(dt / JUMPS_S, 1.0)
    if abs(p - last) > limit:
        if w.jump_age[i] <= JUMP_CYCLES and abs(p - w.before[i]) < 0.25 * abs(p - last):
            w.jumps[i] = min(w.jumps[i] + 1.0, MOST_JUMPS)
            w.jump_age[i] = JUMP_CYCLES
        elif jumps_alone(w, i):
            w.jump_age[i] = 0
        w.before[i] = last
    if w.jumps[i] >= JUMPS - 1.0:
        bad |= JUMPING
    if not on_board:
        return bad
    felt = p - zero[i]
    if felt >= 6.0 * w.sigma[i] and felt >= 0.5 * w.touch[i]:
        note_life(w, i, 1)
    return bad


@inner_kernel
def find_copies(w: Columns, pressures: Floats, fresh: Bools) -> None:
    """Note which boards read what another board reads now, or read before.

    Which of two is the copy is not known where they are of one cycle. Pairs are compared by one number
    each, 8000 of 126 boards: less than one contact costs.
    """
    for p in range(len(fresh)):
        w.code_before[p] = w.code[p]
        w.is_copied[p] = False
        if not fresh[p]:
            continue
        code = np.int64(w.start[p + 1] - w.start[p])
        for i in range(w.start[p], w.start[p + 1]):
            count = pressures[i] / w.step[i] + w.offset[i] if w.step[i] > 0.0 else pressures[i]
            code = (code ^ np.int64(math.floor(count + 0.5))) * MIX + MORE if math.isfinite(count) else code
        w.code[p] = code
    for p in range(len(fresh)):
        if not fresh[p] or w.noise_n[p] < NOISE_SHOWS:
            continue
        for q in range(len(fresh)):
            if q == p or w.code[p] not in (w.code[q], w.code_before[q]):
                continue
            is_now = fresh[q] and w.code[p] == w.code[q]
            is_later = w.code[p] == w.code_before[q] and w.code[p] != w.code_before[p]
            if (is_now or is_later) and _chance_of_board(w, p) < REPEAT_CHANCE:
                w.is_copied[p] = True


@inner_kernel
def _chance_of_board(w: Columns, p: int) -> float:
    """Return the log of the chance that all tactels of a board read some given values."""
    chance = 0.0
    for i in range(w.start[p], w.start[p + 1]):
        chance += log_chance(w, p, i) if w.healthy[i] else 0.0
    return chance


@inner_kernel
def log_chance(w: Columns, p: int, i: int) -> float:
    """Return the log of the chance of a reading to come again, by the declared noise and by what was seen.

    0 where it is not known, or depends on the pressure.
    """
    if w.cycles[i] == 0.0:
        return 0.0
    same = 1.0 - w.changes[i] / (w.cycles[i] + 1.0)
    if same + 0.5 * SHOWN_ERRORS / math.sqrt(w.cycles[i]) <= SHOWN:
        return float(max(w.quiet[i], math.log(same)))
    if w.noise_n[p] < NOISE_SHOWS or w.noise2[i] < (WIDE * w.step[i]) ** 2:
        return 0.0
    # it repeats far more often than noise of this size does: not all tactels are sampled each time
    return float(max(w.quiet[i], math.log(w.step[i] / math.sqrt(math.pi * w.noise2[i]))))
