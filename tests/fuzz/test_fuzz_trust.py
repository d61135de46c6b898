"""Boards that misbehave in every way at once: no wrong contact, and the healthy ones lose nothing."""

import pytest

from tests.fuzz.fuzz_trust import Episode

SEED = 20_261_131
"""Not one of those that anything was tuned on."""


@pytest.mark.slow
def test_boards_that_misbehave_make_no_wrong_contact_and_cost_healthy_ones_nothing():
    print("seed", SEED)
    episode = Episode(SEED)
    n = episode.n
    print(n, episode.violations)
    periods = n["healthy cycles"] + n["left out"]
    assert n["healthy fresh"] >= 0.999 * periods > 0
    assert n["false alarms"] == n["withheld in error"] == 0
    assert not episode.violations
    assert n["contacts of others"] > 500, "they do make contacts"
