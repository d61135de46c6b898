"""Loads from the readings of any source are those of the master, but for what its thresholds move."""

import numpy as np
import pytest

from skinbus.skin.cycle import Readings
from skinbus.skin.pressed import PressedLoads
from tests.master.rig import Rig
from tests.skin.scenes import write


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
        compared += 1
    assert compared > 10
