"""From boards without node-IDs, in random order, to contacts near where they are pressed."""

import numpy as np
import pytest

from tests.master.commissioning.afternoon import Afternoon

SEED = 20261125


@pytest.mark.slow  # a minute of an arm; each of its steps has a quick test of its own
def test_boards_as_they_come_from_the_factory_are_numbered_identified_and_located(tmp_path):
    """Node-IDs are checked on the way; all of it: ``python -m tests.master.commissioning.afternoon``."""
    print(f"seed {SEED}")
    day = Afternoon(tmp_path, 2, SEED)
    day.identify()
    before = day.errors(2)
    day.press_all()
    day.locate()
    after = day.errors(2)
    print("\n".join(day.notes), before, after)
    assert np.mean(after**2) < 0.25 * np.mean(before**2)
