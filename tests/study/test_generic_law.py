"""The law that boards ship with: what the EDS files hold is what is learned."""

import numpy as np
import pytest

from skinbus.model import Radial
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from tools.shipped_law import generic_law

BOARDS = ["skin-patch", "skin-patch-8bit", "skin-patch-8x8", "skin-patch-fd", "skin-patch-fd32"]


@pytest.mark.slow
@pytest.mark.parametrize("name", BOARDS)
def test_shipped_law_is_the_one_that_is_learned(name):
    patch = describe_patch(load_eds(name, 1))
    learned = generic_law(patch)
    assert isinstance(patch.law, Radial)
    d = np.linspace(0.0, 0.03, 61)
    # the step is stored in whole micrometres, the table in 32 bits
    assert np.abs(patch.law.profile(d) - learned.profile(d)).max() <= 1e-3 * learned.table[0]
    # A hundredth: how rounding is weighed moves it by two thousandths on boards of 8 bits.
    assert patch.law.misfit == pytest.approx(learned.misfit, rel=1e-2)
    assert patch.law.exponent == 1.0
