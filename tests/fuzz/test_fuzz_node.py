"""Random frames into the device cores, fifty thousand in full; ``fuzz_node.py`` runs any number."""

import pytest

from tests.fuzz.fuzz_node import DEVICES, fuzz
from tests.run_in_process import run_in_process

SEED = 20260101


@pytest.mark.parametrize("n_frames", [5_000, pytest.param(50_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("which", DEVICES)
def test_random_frames_break_nothing(which, n_frames):
    print(f"seed {SEED}")
    report = run_in_process(fuzz, which, n_frames, SEED)
    assert report.n_sent > n_frames // 50
    assert report.n_dropped > n_frames // 500
    assert report.n_resets > n_frames // 5000
