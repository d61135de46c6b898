"""No reading, however extreme, makes the estimator raise, hang, or answer with what is not a number."""

from tests.hard.extremes import run_extremes


def test_extreme_readings_give_sound_contacts_in_bounded_work():
    # 10^6 cycles: python -m tests.hard --cycles 1000000
    result = run_extremes(4_000, seed=1)
    print("seed 1", result.n_contacts, result.most_work, result.most_ms)
    assert not result.faults, result.faults[:10]
    assert result.n == 4_000
    assert result.n_contacts > 2_000
