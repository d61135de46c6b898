"""A hundred thousand random frames into the device cores; ``fuzz_node.py`` runs as many as one likes."""

import pytest

from tests.fuzz.fuzz_node import DEVICES, fuzz
from tests.run_in_process import run_in_process

SEED = 20260101
N_FRAMES = 50_000


@pytest.mark.parametrize("which", DEVICES)
def test_random_frames_break_nothing(which):
    print(f"seed {SEED}")
    report = run_in_process(fuzz, which, N_FRAMES, SEED)
    assert report.n_sent > 1000
    assert report.n_dropped > 100
    assert report.n_resets > 10
