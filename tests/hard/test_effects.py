"""Effects of a real skin with the law that ships: contacts are true within what they say, or flagged."""

import pytest

from tests.hard.effects import EFFECTS, SEED, run_effect


@pytest.mark.parametrize(
    "name", ["inclined push", *(pytest.param(name, marks=pytest.mark.slow) for name in EFFECTS)]
)
@pytest.mark.parametrize("level", ["fit", "full"])
def test_contacts_are_within_six_sd_or_flagged(name, level):
    print(f"seed {SEED}")
    outcome = run_effect(name, level)
    print(outcome)
    assert outcome.n_touches > 300
    assert outcome.faults == ()
