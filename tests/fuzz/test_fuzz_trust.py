"""Boards that misbehave in every way at once; ``fuzz_trust.py`` runs any number of cycles."""

import pytest

from tests.fuzz.fuzz_trust import N_BOARDS, N_HEALTHY, Episode, fuzz

SEED = 20_261_131
"""Not one of those that anything was tuned on."""


def check(n, violations):
    print(n, violations)
    periods = n["healthy cycles"] + n["left out"]
    assert n["healthy fresh"] >= 0.999 * periods > 0
    assert n["false alarms"] == n["withheld in error"] == 0
    assert not violations


@pytest.mark.slow
def test_boards_that_misbehave_make_no_wrong_contact_and_cost_healthy_ones_nothing():
    print("seed", SEED)
    episode = Episode(SEED, seconds=5)
    check(episode.n, episode.violations)
    assert episode.n["contacts of others"] > 50, "they do make contacts"


@pytest.mark.slow
def test_the_same_for_longer():
    print("seed", SEED + 1)
    n, violations = fuzz(2 * 950 * (N_BOARDS - N_HEALTHY), SEED + 1)
    check(n, violations)
    assert n["contacts of others"] > 3000
