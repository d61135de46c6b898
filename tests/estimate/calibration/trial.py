"""What comes of a file of presses drawn at random, and corrupted."""

from typing import NamedTuple

import numpy as np

from skinbus.estimate.calibration import Judgement, judge
from tests.estimate.calibration.corruptions import PressedBoards

LIMIT_M = 1e-3
"""Error of places above which nothing may be accepted without a word."""
SAID = 1.5
"""By which an error that is said may be exceeded: quantiles of 40 touches differ by half."""


class Outcome(NamedTuple):
    """What came of one file."""

    judgement: Judgement
    error: float
    """m, of places at new touches; 0 where it was refused."""

    @property
    def verdict(self):
        """In one word."""
        if self.judgement.faults:
            return "refused"
        if self.error < LIMIT_M:
            return "accepted"
        # too coarse a board for better places, which the judgement says
        is_said = self.judgement.place_error > LIMIT_M and self.error < SAID * self.judgement.place_error
        return "accepted and said" if is_said else "WRONG"


def outcome(seed, corrupt=None, **options):
    """Return what comes of presses drawn by a seed, and corrupted."""
    rng = np.random.default_rng(seed)
    boards = PressedBoards.draw(rng, **options)
    table = boards.table if corrupt is None else corrupt(boards.table, rng)
    judgement = judge(table)
    error = 0.0 if judgement.faults else boards.error(judgement.calibration.apply(boards.arm))
    return Outcome(judgement, error)
