"""Boards that misbehave in every way at once; ``fuzz_trust.py`` runs any number of cycles."""

import pytest

from tests.fuzz.fuzz_trust import fuzz

SEED = 1


@pytest.mark.slow
def test_late_torn_doubled_and_remapped_readings_make_no_wrong_contact_and_cost_a_healthy_board_nothing():
    """Frozen readings are found by plausibility, which takes a second; that is not asserted here.

    "none" and "fades" are what the estimator itself misses on an elastic layer.
    """
    print("seed", SEED)
    n, violations = fuzz(1, SEED)
    print(n, violations)
    assert n["healthy fresh"] >= 0.999 * n["healthy cycles"] > 0
    assert n["contacts of others"] > 300
    assert {violation[3] for violation in violations} <= {"none", "fades", "frozen"}
