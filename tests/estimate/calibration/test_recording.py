"""A log without a press is not joined with a recording; what is found in others, test_presses.py holds."""

import numpy as np
import pytest

from skinbus.estimate.calibration.recording import find_offset


def test_signals_without_a_press_are_refused():
    t = np.arange(0.0, 10.0, 0.01)
    with pytest.raises(ValueError, match="without a press"):
        find_offset(t, np.zeros(len(t)), t, np.ones(len(t)))
