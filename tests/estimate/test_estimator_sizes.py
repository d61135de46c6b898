"""What presses has a size that nobody has measured: contacts under the law that ships know that."""

import numpy as np
import pytest

from skinbus.estimate import Estimator
from skinbus.model import Arm, Cone
from skinbus.model.patch import grid
from tests.estimate.sized_presses import SizedPresses


@pytest.mark.parametrize("size_mm", [2.0, 5.0, 12.0, 25.0])
def test_contacts_are_true_within_their_covariance_whatever_presses(size_mm):
    nees, place, force, single = SizedPresses(size_mm).measure("fit", 150, 61)
    print("seed 61", nees, place, force)
    assert single == 150
    assert 0.5 <= nees <= 2.0


@pytest.mark.parametrize("level", ["fit", "full"])
def test_widths_order_what_presses_by_size(level):
    widths = []
    for size_mm in (2.0, 12.0, 25.0):
        presses = SizedPresses(size_mm)
        contacts = Estimator(presses.arm, level).update(presses.clean(np.array([0.005, 0.002, 10.0])), 0)
        assert len(contacts) == 1
        assert contacts.width_sd[0] > 0.0
        widths.append(float(contacts.width[0]))
    assert widths == sorted(widths)


def test_widths_of_a_law_that_was_measured_with_what_presses_are_held():
    arm = Arm.single_patch(grid(4, 4, 0.010), law=Cone())
    d = arm.links[0].surface.distance(arm.tactel_s, arm.tactel_a, 0.002, 0.001)
    contacts = Estimator(arm, "fit").update(arm.patches[0].patch.law.pressure(d, 5.0), 0)
    assert contacts.width.tolist() == [1.0]
    assert contacts.width_sd.tolist() == [0.0]
