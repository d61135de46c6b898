"""Random frames into the master, a hundred thousand in full; ``fuzz_master.py`` runs any number."""

import pytest

from skinbus.master.patches.table import TRANSITIONS, PatchState
from tests.fuzz.fuzz_master import fuzz
from tests.run_in_process import run_in_process

SEED = 20260103


@pytest.mark.parametrize("n_frames", [5_000, pytest.param(40_000, marks=pytest.mark.slow)])
def test_random_frames_break_nothing(n_frames):
    print(f"seed {SEED}")
    report = run_in_process(fuzz, n_frames, SEED)
    assert report.n_sent > n_frames // 10
    if n_frames < 40_000:
        return
    # A master that is reset is the only thing that random frames hardly ever bring about.
    # Nor all readings of a silent patch in one cycle, nor two boards in step.
    rare = {
        (PatchState.SILENT, PatchState.OPERATIONAL),
        (PatchState.OPERATIONAL, PatchState.WRONG),
        (PatchState.SILENT, PatchState.WRONG),
    }
    needed = {change for change in TRANSITIONS if change[1] is not PatchState.ABSENT} - rare
    assert needed <= report.kinds, f"never seen: {needed - report.kinds}"
