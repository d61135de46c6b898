"""From boards without node-IDs, in random order, to contacts near where they are pressed."""

import numpy as np
import pytest

from tests.master.commissioning.afternoon import Afternoon, spend

SEED = 20261125


@pytest.mark.slow
def test_boards_without_node_ids_are_identified_and_located_on_the_bus(tmp_path):
    """The first half of the afternoon, with the six presses a board that locate it."""
    day = Afternoon(tmp_path, 2, SEED + 1, n_presses=0)
    day.identify()
    before = day.errors(3)
    day.press_all()
    day.locate()
    after = day.errors(3)
    print("\n".join(day.notes), before, after)
    assert np.sqrt(np.mean(after**2)) < 0.5 * np.sqrt(np.mean(before**2))
    assert not day.false


@pytest.mark.slow  # two minutes of an arm; each of its steps has a quick test of its own
def test_boards_as_they_come_from_the_factory_become_a_skin_that_is_true(tmp_path):
    """Node-IDs are checked on the way; 24 boards: ``python -m tests.master.commissioning.afternoon 24``."""
    print(f"seed {SEED}")
    day, errors = spend(tmp_path, 2, SEED, n_each=6)
    rms = {step: np.sqrt(np.mean(own**2)) for step, own in errors.items()}
    print("\n".join(day.notes), rms)
    assert rms["located"] < 0.5 * rms["identified"]
    assert rms["calibrated"] < 0.5 * rms["identified"]
    assert not day.false
