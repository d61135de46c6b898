"""No reading, however extreme, makes the estimator raise, hang, or answer with what is not a number."""

import pytest

from tests.hard.extremes import run_extremes


@pytest.mark.parametrize("n_cycles", [150, pytest.param(1_500, marks=pytest.mark.slow)])
def test_extreme_readings_give_sound_contacts_in_bounded_work(n_cycles):
    result = run_extremes(n_cycles, seed=1)
    print("seed 1", result.n_contacts, result.most_work, result.most_ms)
    assert not result.faults, result.faults[:10]
    assert result.n == n_cycles
    assert result.n_contacts > n_cycles // 2
