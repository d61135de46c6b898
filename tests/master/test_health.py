"""What a tactel has gone through is counted; another board begins anew."""

import json
from dataclasses import replace

import numpy as np
import pytest

from skinbus.model import Arm
from tests.master.watched import Watched

SEED = 20261203
SERIAL = 0xFEDCBA98


@pytest.fixture(scope="module")
def settled():
    """A board that is commissioned."""
    watched = Watched(SEED)
    watched.cycle.serials[:] = SERIAL
    watched.settle()
    return json.loads(json.dumps(watched.tables()))


def test_faults_are_counted(settled):
    watched = Watched(SEED + 1, tables=settled)
    watched.cycle.serials[:] = SERIAL
    watched.zero[:] = 600.0
    watched.zero[2] = -30e3  # out of its band
    watched.run(20)
    assert watched.health.records["faults"][2] >= 1
    assert watched.health.records["seen"][2] > 0
    assert np.isfinite(watched.health.records["zero_first"]).all()


def test_another_board_or_calibration_begins_anew(settled):
    arm = Watched(SEED).arm
    other = Arm(arm.name, arm.links, [replace(arm.patches[0], serial=77)], *arm.buses)
    watched = Watched(SEED, arm=other, tables=settled)
    assert np.isnan(watched.health.records["zero_first"]).all()
