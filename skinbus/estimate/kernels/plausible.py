"""One cycle of the judgement of tactels: rails, repeated readings, frozen and jumping tactels.

:mod:`skinbus.estimate.plausibility` says by which rules, ``silence`` which tactels are alone or dead.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.silence import (
    DEAD,
    JUMP_SIGMAS,
    Columns,
    end_touch,
    is_alone,
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
LEAST_FULL: Final = 4
"""Tactels of a board that all of them are: one contact may saturate fewer."""
CRUSHED: Final = 0.5
"""Of full scale: a supply that fails comes from below it at once."""
JUMP_SHARE: Final = 0.5
"""Of full scale: what comes there by more, and alone, is stuck."""
JUMP_CYCLES: Final = 3
"""Cycles in which a jump comes back."""
JUMPS, JUMPS_S = 5.0, 5.0
"""So many within so long, s: a bit error now and then is not a fault of the tactel."""
MOST_JUMPS: Final = 7.0
"""Jumps that are counted: a tactel that has ceased to jump is plausible four seconds later."""

SHOWN: Final = 0.45
"""Share of readings of a free tactel that come again, with four standard errors, below which noise shows at
every pressure. Noise of less than half a step repeats half of them where it is between two steps, and all in
the middle of one."""
FORGET_CYCLES: Final = 2000
"""It is that of the last so many cycles."""
SUSPECT: Final = math.log(1e-5)
"""Chance of repetitions of tactels in a row to be new samples, below which they are missing."""
REPEAT_CHANCE: Final = math.log(1e-9)
"""The same of a whole board: once in eleven days at 1 kHz."""
CHANCE: Final = 2.0 * math.log(1e-15)
"""Of one run of readings to call a healthy tactel frozen: 400 tactels at 1 kHz have 10^13 runs in a year. It
counts twice: a pressed reading may lie in the middle of a step, where it changes less often."""
FREEZE_LEAST: Final = 20
"""Readings: no shorter run is frozen, and no tactel that has changed less than five times as often."""


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
    for p in range(len(fresh)):
        w.is_withheld[p] = w.is_repeated[p] = False
        if not fresh[p]:
            continue
        _compare(w, p, pressures)
        i0, i1 = w.start[p], w.start[p + 1]
        is_touched = False
        for i in range(i0, i1):
            is_touched |= touched[i] != 0
        w.quiet_s[p] = 0.0 if is_touched else w.quiet_s[p] + dt
        if w.quiet_s[p] > RAIL_S:
            end_touch(w, p)
        is_touched &= not w.is_full[p]
        for i in range(i0, i1):
            if w.healthy[i] and math.isfinite(pressures[i]):
                is_free = touched[i] == 0 and abs(pressures[i] - zero[i]) < 3.0 * w.sigma[i]
                bad = BAND if out[i] else 0
                bad |= _judge_rail(w, p, i, pressures, zero, dt)
                bad |= _judge_changes(w, i, pressures[i], is_free, dt)
                _note(w, i, bad, dt)
                felt = pressures[i] - zero[i]
                if is_touched and felt >= 6.0 * w.sigma[i] and felt >= 0.5 * w.touch[i]:
                    note_life(w, i, 1)
        watch_touch(w, p, pressures, zero, is_touched)
        n_faulty = 0
        for i in range(i0, i1):
            w.last[i] = pressures[i]
            n_faulty += w.fault[i] != 0
            # the baseline watches for a return to the band; what is not named yet is not used either
            if w.fault[i] & ~BAND != 0 or (w.fault[i] == 0 and (w.is_old[i] or w.rail_n[i] > 0)):
                pressures[i] = math.nan
        w.n_faulty[p] = n_faulty


@inner_kernel
def _note(w: Columns, i: int, bad: int, dt: float) -> None:
    """Note what is wrong with a tactel now; what was stays for a time, but of its band the baseline knows."""
    held = w.fault[i] & ~BAND
    if bad & ~BAND != 0:
        w.good_s[i] = 0.0
    elif held != 0:
        w.good_s[i] += dt
        if w.good_s[i] >= RETURN_S:
            held &= DEAD
    w.fault[i] = held | bad


@inner_kernel
def _compare(w: Columns, p: int, pressures: Floats) -> None:
    """Compare the readings of a board with those before, and with full scale.

    Repetitions of tactels that follow each other count together: those of a PDO come again together.
    """
    n, n_same, n_hard, n_full = 0, 0, 0, 0
    begin, run, chance, i0, i1 = w.start[p], 0.0, 0.0, w.start[p], w.start[p + 1]
    for i in range(i0, i1 + 1):
        own = 0.0
        if i < i1:
            value = pressures[i]
            w.change[i] = value - w.last[i] if math.isfinite(w.last[i]) else math.inf
            w.is_old[i] &= w.change[i] == 0.0
            if w.healthy[i] and math.isfinite(value):
                n += 1
                n_hard += value >= CRUSHED * w.high[i]
                n_full += value >= w.high[i]
                if w.change[i] == 0.0:
                    n_same += 1
                    w.still[i] += 1
                    if w.low[i] < value < w.high[i]:
                        own = _log_same(w, i)
        if own < 0.0:
            chance += own
            run += own * w.still[i]
            continue
        if i > begin and run + math.log(i1 - i0) * (i > begin + 1) < SUSPECT:
            for j in range(begin, i):
                w.is_old[j] = True
        begin, run = i + 1, 0.0
    is_full = n_full == n >= LEAST_FULL  # its supply fails, or force has brought it there
    if not is_full:
        w.is_crushed[p] = 2 * n_hard >= n > 0
    w.is_full[p] = is_full and not w.is_crushed[p]
    w.is_repeated[p] = n_same == n and chance < REPEAT_CHANCE
    w.is_withheld[p] = w.is_full[p] or w.is_repeated[p]
    if w.is_repeated[p]:
        for i in range(i0, i1):
            w.was_old[i] = True


@inner_kernel
def _log_same(w: Columns, i: int) -> float:
    """Return the log of the chance of a reading to come again; 0 where that is not known."""
    same = 1.0 - w.changes[i] / (w.cycles[i] + 1.0)
    if w.cycles[i] == 0.0 or same + 2.0 / math.sqrt(w.cycles[i]) > SHOWN:
        return 0.0
    return float(max(w.quiet[i], math.log(same)))


@inner_kernel
def _judge_rail(w: Columns, p: int, i: int, pressures: Floats, zero: Floats, dt: float) -> int:
    """Return whether a tactel is at a rail, or reads alone what no contact explains."""
    value, is_lone = pressures[i], False
    is_at_top = value >= w.high[i]
    if not w.is_full[p]:
        if is_at_top and w.change[i] >= JUMP_SHARE * w.high[i] and jumps_alone(w, i):
            w.lone_n[i] = RAIL_READINGS  # whatever touches beside it later
        # what came to full scale alone is stuck until it leaves it
        is_lone = is_at_top and w.lone_n[i] >= RAIL_READINGS
        is_lone = is_lone or is_alone(w, p, i, pressures, zero)
    w.lone_n[i] = w.lone_n[i] + 1 if is_at_top and is_lone else 0
    w.rail_n[i] = w.rail_n[i] + 1 if is_lone or value <= w.low[i] or w.is_full[p] else 0
    return RAIL if w.rail_n[i] >= RAIL_READINGS and w.rail_n[i] * dt >= RAIL_S else 0


@inner_kernel
def _judge_changes(w: Columns, i: int, value: float, is_free: bool, dt: float) -> int:
    """Return whether a tactel is frozen or jumps; learn how often a free one repeats."""
    bad, change, still = 0, abs(w.change[i]), w.still[i]
    if change == 0.0:
        rate = w.changes[i] / max(w.cycles[i], 1.0)
        if still >= FREEZE_LEAST and w.changes[i] >= 5 * FREEZE_LEAST and value < w.high[i]:
            bad = FROZEN if still * math.log(min(max(1.0 - rate, 0.05), 0.999)) < CHANCE else 0
        w.was_old[i] |= w.is_old[i] or not w.low[i] < value < w.high[i]
    else:
        # a run counts when it is over, and if all of it was new: a frozen one does not change the rate
        if is_free and still < FORGET_CYCLES and not w.was_old[i]:
            keep = 0.5 if w.cycles[i] > FORGET_CYCLES else 1.0
            w.cycles[i] = keep * (w.cycles[i] + still + 1.0)
            w.changes[i] = keep * (w.changes[i] + 1.0)
        w.still[i] = 0
        w.was_old[i] = False
    w.jump_age[i] += 1
    w.jumps[i] -= w.jumps[i] * min(dt / JUMPS_S, 1.0)
    if max(w.touch[i], JUMP_SIGMAS * w.sigma[i]) < change < math.inf:
        if w.jump_age[i] <= JUMP_CYCLES and abs(value - w.before[i]) < 0.25 * change:
            w.jumps[i] = min(w.jumps[i] + 1.0, MOST_JUMPS)
            w.jump_age[i] = JUMP_CYCLES
        elif jumps_alone(w, i):
            w.jump_age[i] = 0
        w.before[i] = w.last[i]
    return bad | JUMPING if w.jumps[i] >= JUMPS - 1.0 else bad
