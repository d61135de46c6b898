"""A hundred thousand random frames into the master; ``fuzz_master.py`` runs as many as one likes."""

from skinbus.master.patches.table import TRANSITIONS, PatchState
from tests.fuzz.fuzz_master import fuzz
from tests.run_in_process import run_in_process

SEED = 20260103
N_FRAMES = 100_000


def test_random_frames_break_nothing():
    print(f"seed {SEED}")
    report = run_in_process(fuzz, N_FRAMES, SEED)
    assert report.n_sent > 10_000
    # A master that is reset is the only thing that random frames hardly ever bring about.
    needed = {change for change in TRANSITIONS if change[1] is not PatchState.ABSENT}
    assert needed <= report.kinds, f"never seen: {needed - report.kinds}"
