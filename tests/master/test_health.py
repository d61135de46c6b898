"""What changes in a tactel since commissioning is named, and nothing else."""

import json
from dataclasses import replace

import numpy as np
import pytest

from skinbus.master.health import SETTLED, findings, read_health
from skinbus.model import Arm
from tests.master.watched import Watched

SEED = 20261203


def found(watched):
    return findings(watched.arm, read_health(watched.arm, watched.tables()))


@pytest.fixture(scope="module")
def settled():
    """A board that is commissioned."""
    watched = Watched(SEED)
    watched.zero[:] = 600.0
    watched.run(10 * SETTLED + 30)
    return json.loads(json.dumps(watched.tables()))


def board(tables, **changes):
    """The same board, later."""
    watched = Watched(SEED + 1, tables=tables)
    assert watched.taken == 1
    watched.zero[:] = 600.0
    for name, values in changes.items():
        getattr(watched, name)[:] = values
    return watched


def test_a_healthy_board_has_no_findings_and_references(settled):
    watched = board(settled)
    watched.run(600)
    own = watched.health.records
    np.testing.assert_allclose(own["zero_first"], 600.0, atol=200.0)
    np.testing.assert_allclose(own["noise_first"], 200.0, rtol=0.5)
    assert found(watched) == []


def test_a_noisy_tactel_and_a_zero_that_moved_are_named(settled):
    noise, zero = np.full(16, 200.0), np.full(16, 600.0)
    noise[3] = 900.0
    zero[7] = -2300.0
    watched = board(settled, noise=noise, zero=zero)
    watched.run(400)
    said = {finding.what.split()[0]: finding.tactels for finding in found(watched)}
    assert said == {"noise": (4,), "zeros": (8,)}


def test_touches_and_faults_are_counted(settled):
    watched = board(settled)
    before = watched.health.records["touches"].copy()
    for _ in range(5):
        watched.run(3, 25e-3, 0.0, 5.0)
        watched.run(5)
    counted = watched.health.records["touches"] - before
    assert counted[5] == 5
    watched.zero[2] = -30e3  # out of its band
    watched.run(20)
    assert watched.health.records["faults"][2] >= 1
    assert watched.health.records["seen"][2] > 0


def test_another_board_or_calibration_begins_anew(settled):
    arm = Watched(SEED).arm
    other = Arm(arm.name, arm.links, [replace(arm.patches[0], serial=77)], *arm.buses)
    watched = Watched(SEED, arm=other, tables=settled)
    assert watched.taken == 0
    assert np.isnan(watched.health.records["zero_first"]).all()
