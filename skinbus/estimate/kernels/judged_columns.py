"""What the judgement of tactels keeps from cycle to cycle, by tactel and by patch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Singles = npt.NDArray[np.float32]


class Columns(NamedTuple):
    """Columns per tactel (n,) and per patch (p,)."""

    start: Ints  # (p + 1,)
    healthy: Bools
    high: Floats  # Pa, full scale
    low: Floats  # Pa, the lower end
    sigma: Floats  # Pa, with the rounding of the counts
    touch: Floats  # Pa
    neighbour_start: Ints  # (n + 1,) of the same board
    neighbour: Ints
    away: Floats  # (m, 2) pitches, from the tactel to each neighbour
    is_next: Bools  # (m,) whether it is one step away: on a square, the diagonals too
    beside: Floats  # (p,) part of the peak of the narrowest contact that is left one pitch off
    wide: Singles  # (rows, PLACES^2) part of the peak of a contact at a place that a tactel feels
    narrow: Singles  # the same of the narrowest contact
    tried_row: Ints  # (n,) row of the first neighbour of each tactel
    own_row: Ints  # (p,) row of the tactel itself
    up: Floats  # scratch, by place and width
    down: Floats
    turn: Ints  # (p,) the next tactel to look at in the window before
    fault: npt.NDArray[np.uint8]  # (n,)
    last: Floats  # as used last
    newest: Floats  # as came last, used or not
    pause: Ints  # (p,) cycles since a reading that differs from the one before
    n_unused: Ints  # (p,) cycles since one that was used
    lone_n: Ints  # readings in a row alone at full scale
    is_stuck: Bools  # came to full scale alone, and is still there
    change: Floats  # scratch, Pa
    noise2: Floats  # Pa^2, mean square of the changes of a free tactel
    nothing: Floats  # zeros
    before: Floats  # the reading before a jump
    jump_age: Ints  # cycles since it
    jumps: Floats
    still: Ints  # readings in a row without change
    quiet: Floats  # log of the largest chance of a reading to come again, by the declared noise
    log_chance: Floats  # that of a reading that has come again, 0 where nothing follows from it
    longest: Ints  # (p,) readings that have come again so often are no new samples, 0: all may be new
    same: Ints  # (p,) cycles in a row in which all readings of a board came again
    slow_n: Ints  # (p,) changes of a board by noise at once, each after all of it has come again
    went_up: Bools  # at its last change
    noise_n: Ints  # (p,) the last changes of a board that were by noise, by which noise shows
    apart: Ints  # of ``still``, in short runs of these
    is_old: Bools  # has come again so often, in this run
    run_chance: Floats  # log of the chance of this run to be of new samples, with what neighbours say
    step: Floats  # Pa of a count
    alone: Bools  # reads what no contact explains beside its neighbours
    is_full: Bools  # (p,) all readings of the board are at full scale, and came there at once
    is_crushed: Bools  # (p,) half of its readings were in the upper half of their range before
    is_withheld: Bools  # (p,) that, or the readings are too unlikely to be new
    code: Ints  # (p,) of the counts of all tactels, as came now: equal for equal counts
    code_before: Ints  # (p,) ... before that
    is_copied: Bools  # (p,) the readings are those of another board
    offset: Floats  # counts at no pressure
    cycles: Floats  # while free, of the rate of change
    changes: Floats
    rail_s: Floats
    rail_n: Ints
    touches: Ints  # in a row that it should have felt and has not
    evident: Bools  # in this touch
    due: Floats  # sum over windows of the square of what it should have read at least, in noise
    shown: Floats  # the same of that times what it read
    where: Floats  # (n, 2) pitches, of the first touch that it should have felt
    best: Ints  # (1,) scratch, the place that explains the neighbours best
    window_n: Ints  # (p,) cycles in the window
    window_first: Floats  # Pa, its first reading
    window_sum: Floats  # Pa, less the zero
    mean: Floats  # Pa, of the window before
    mean_n: Ints  # (p,) its cycles, 0: all tactels have been looked at
    felt_n: Ints
    good_s: Floats  # since it was implausible last
    quiet_s: Floats  # (p,) since the board was touched
    n_faulty: Ints  # (p,)
