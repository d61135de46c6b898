"""Numbers of patches in the picture of a scene: whole, and with their bus where there are several."""

import pytest

from skinbus.config.system import load_arm
from skinbus.sim.picture import number_place


@pytest.mark.parametrize("name", ["pad", "forearm", "arm-two-buses"])
def test_numbers_are_inside_and_each_is_there_once(name):
    arm = load_arm(name)
    assert len({arm.node_label(p) for p in range(arm.n_patches)}) == arm.n_patches
    for placed in arm.patches:
        surface = arm.links[placed.link].surface
        a, s = number_place(surface, placed)
        assert abs(a) < 500.0 * surface.width - 5.0
        assert s == pytest.approx(1e3 * placed.s)
