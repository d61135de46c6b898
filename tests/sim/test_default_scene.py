"""An arm without a scene has one: boards all over it are pressed, one after the other."""

import numpy as np
import pytest

from skinbus.config.arm_file import find_arm
from skinbus.sim import load_scene
from skinbus.sim.default_scene import MOST


@pytest.mark.parametrize("arm", ["forearm", "arm", "pad", "arm-two-buses"])
def test_an_arm_file_stands_for_its_default_scene(arm):
    scene = load_scene(find_arm(arm))
    assert scene.arm.name == arm or scene.arm.n_patches
    pressed = [scene.touches_at(t_s) for t_s in np.arange(0.0, scene.duration_s, 0.25)]
    numbers = {int(touch) for touches in pressed for touch in touches.touch}
    assert len(numbers) == min(MOST, scene.arm.n_patches)
    assert max(len(touches.touch) for touches in pressed) == 1
    assert not len(pressed[0].touch)
    assert scene.duration_s <= 11.0
