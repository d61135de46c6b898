"""From boards without node-IDs, in random order, to contacts: every command in its order."""

import numpy as np
import pytest

from tests.master.commissioning.afternoon import spend

SEED = 20261125


@pytest.mark.slow  # two minutes of an arm; each of its steps has a quick test of its own
def test_four_boards_of_the_factory_give_contacts_where_they_are_pressed(tmp_path):
    print(f"seed {SEED}")
    day, errors = spend(tmp_path, 4, SEED)
    rms = {step: 1e3 * np.sqrt(np.mean(own**2)) for step, own in errors.items()}
    print("\n".join(day.notes), rms)
    assert rms["identified"] > rms["calibrated"]
    assert rms["calibrated"] < 0.3
