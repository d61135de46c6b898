"""Arguments of a wrong kind are refused by name."""

import numpy as np
import pytest

import skinbus
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface


@pytest.mark.parametrize("name", ["Estimator", "Tracker", "Baseline", "Master"])
def test_what_is_no_arm_is_refused(name):
    with pytest.raises(
        TypeError, match=r"arm must be an Arm, as skinbus\.load_arm returns it; got 'forearm'"
    ):
        getattr(skinbus, name)("forearm")


@pytest.mark.parametrize("s", [0.01, 0.295, 0.7])
@pytest.mark.parametrize("surface", [Surface.cylinder(0.3, 0.05), Surface.cone(0.3, 0.09, 0.05)])
def test_board_beyond_the_end_of_a_link_or_the_apex_of_its_cone_is_refused(surface, s):
    placed = PlacedPatch(patch=Patch.default(), node_id=1, link=0, s=s, a=0.0)
    with pytest.raises(ValueError, match="tube has tactels at s = "):
        skinbus.Estimator(Arm("test", [Link("tube", surface)], [placed]))


@pytest.mark.parametrize(("name", "value"), [("k", 1.5), ("seed", "x"), ("budget_work", 0.5)])
def test_what_is_no_integer_is_refused_by_name(name, value):
    with pytest.raises(TypeError, match=f"{name} must be an integer"):
        skinbus.Estimator(skinbus.load_arm("pad"), **{name: value})


def test_pressures_are_real():
    with pytest.raises(TypeError, match="pressures must be real"):
        skinbus.Estimator(skinbus.load_arm("pad")).update(np.zeros(16, complex), 0)
