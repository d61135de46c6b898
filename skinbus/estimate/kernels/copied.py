"""Readings that are equal bit by bit: the chance of it, and boards that read what another board reads."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.judged_columns import Columns
from skinbus.jit import inner_kernel

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

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
