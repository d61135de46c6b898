"""Hostile files and datagrams, some hundred of each kind; ``fuzz_readers.py`` runs any number."""

import pytest

from tests.fuzz.fuzz_readers import MAX_S, fuzz

SEED = 20260102


@pytest.mark.parametrize("n", [600, pytest.param(3_000, marks=pytest.mark.slow)])
def test_no_input_raises_what_is_not_ours_or_takes_long(n):
    print(f"seed {SEED}")
    slowest = fuzz(n, SEED).slowest
    assert len(slowest) == 12
    assert max(slowest.values()) < 5 * MAX_S  # on a machine that is busy; the command holds the limit itself
