"""The gate against many files of presses: ``python -m tests.estimate.calibration.trial SEED FIRST LAST``.

Prints each file with its outcome, and at the end how many were refused and the largest error of those that
were accepted. ``clean``: nothing is wrong with the files, so that each refusal is a false one. ``tests`` run
a few of them; two hundred take twenty minutes.
"""

import sys
from collections import Counter
from typing import NamedTuple

import numpy as np

from skinbus.estimate.calibration import Judgement, judge
from tests.estimate.calibration.corruptions import CORRUPTIONS, PressedBoards

LIMIT_M = 1e-3
"""Error of places above which nothing may be accepted without a word."""
SAID = 1.5
"""By which an error that is said may be exceeded: quantiles of 40 touches differ by half."""


class Outcome(NamedTuple):
    """What came of one file."""

    name: str
    boards: str
    judgement: Judgement
    error: float
    """m, of places at new touches; 0 where it was refused."""

    @property
    def verdict(self) -> str:
        """In one word."""
        if self.judgement.faults:
            return "refused"
        if self.error < LIMIT_M:
            return "accepted"
        # too coarse a board for better places, which the judgement says
        is_said = self.judgement.place_error > LIMIT_M and self.error < SAID * self.judgement.place_error
        return "accepted and said" if is_said else "WRONG"


def outcome(seed: object, corrupt=None, **options) -> Outcome:
    """Return what comes of presses drawn by a seed, and corrupted."""
    rng = np.random.default_rng(seed)
    boards = PressedBoards.draw(rng, **options)
    table = boards.table if corrupt is None else corrupt(boards.table, rng)
    judgement = judge(table)
    error = 0.0 if judgement.faults else boards.error(judgement.calibration.apply(boards.arm))
    patch = boards.arm.patches[0].patch
    about = f"{boards.arm.n_patches} x {patch.n_tactels}, {patch.transducer.bits} bits, {len(table)} presses"
    return Outcome("clean" if corrupt is None else corrupt.__name__, about, judgement, error)


def main(seed: int, first: int, last: int, *, is_clean: bool) -> None:
    """Print the outcomes of files ``first`` to ``last``, exclusive."""
    counts: Counter[tuple[str, str]] = Counter()
    worst = 0.0
    for k in range(first, last):
        found = outcome([seed, k], None if is_clean else CORRUPTIONS[k % len(CORRUPTIONS)])
        counts[found.name, found.verdict] += 1
        worst = max(worst, found.error)
        judged = found.judgement
        print(
            f"{k} {found.name}: {found.verdict} ({found.boards}), {len(judged.outliers)} left out, "
            f"error {1e3 * found.error:.2f} mm, expected {1e3 * judged.place_error:.2f} mm",
            flush=True,
        )
        if found.verdict == ("refused" if is_clean else "WRONG"):
            print(*(f"    {finding.what}" for finding in (*judged.faults, *judged.notes)), sep="\n")
    for (name, verdict), n in sorted(counts.items()):
        print(f"{n:4} {name} {verdict}")
    print(f"largest error of those accepted: {1e3 * worst:.2f} mm")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:4]), is_clean="clean" in sys.argv[4:])
