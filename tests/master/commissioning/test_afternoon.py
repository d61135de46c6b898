"""From boards without node-IDs, in random order, to contacts: every command in its order."""

import numpy as np
import pytest

from tests.master.commissioning.afternoon import spend

SEED = 20261125
N_CONTACTS = 24


@pytest.mark.slow  # a minute and a half of an arm; each of its steps has a quick test of its own
def test_boards_as_they_come_from_the_factory_give_contacts_where_they_are_pressed(tmp_path):
    print(f"seed {SEED}")
    day, errors = spend(tmp_path, 2, SEED, N_CONTACTS)
    rms = {step: 1e3 * np.sqrt(np.mean(own**2)) for step, own in errors.items()}
    print("\n".join(day.notes), rms)
    # 0.3 mm, and two standard deviations of such a mean of 24 contacts
    assert rms["calibrated"] < 0.3 * (1.0 + 2.0 / np.sqrt(4 * N_CONTACTS))
    assert rms["calibrated"] < 0.5 * rms["identified"]
