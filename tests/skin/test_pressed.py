"""Loads from the readings of any source are those of the master, but for what its thresholds move."""

import numpy as np
import pytest

from skinbus.skin.cycle import Readings
from skinbus.skin.pressed import PressedLoads
from tests.master.rig import Rig
from tests.skin.scenes import write
from tests.view.web.cycles import ARM


def test_nothing_pressed_is_no_load_and_no_reading_is_none():
    pressed = PressedLoads(ARM)
    n = ARM.n_tactels
    nothing = Readings(np.zeros(n), np.ones(n, np.bool_), np.zeros(n, np.uint8))
    unknown = Readings(np.zeros(n), np.zeros(n, np.bool_), np.zeros(n, np.uint8))
    assert pressed.of(nothing).force == 0.0
    assert pressed.of(unknown).force == 0.0


def test_loads_are_those_of_the_master_where_a_press_is_well_above_the_threshold(tmp_path):
    rig = Rig(write(tmp_path), level="fit")
    rig.run(1000)
    arm = rig.scene.arm
    pressed, compared = PressedLoads(arm), 0
    for report in rig.reports:
        if report.loads.force < 2.0 or not report.fresh.all():
            continue
        valid = np.ones(arm.n_tactels, np.bool_)
        loads = pressed.of(Readings(report.pressures, valid, np.zeros(arm.n_tactels, np.uint8)))
        assert loads.force == pytest.approx(report.loads.force, rel=0.05)
        assert loads.links.force.sum() == pytest.approx(loads.patches.force.sum())
        compared += 1
    assert compared > 10
