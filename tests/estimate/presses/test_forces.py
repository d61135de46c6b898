"""Stated forces that no cover makes of the readings: another scale from some row on, or a tare."""

import re

import numpy as np
import pytest

from skinbus.estimate.presses.cross_validation import HeldOutErrors
from skinbus.estimate.presses.forces import uneven_forces
from skinbus.estimate.presses.table import PressTable
from skinbus.model import Arm
from skinbus.model.patch import grid

N = 60


def named(exponent, stated):
    """Forces that a calibration finds of forces from 3 to 15 N, after it took the stated ones for true."""
    rng = np.random.default_rng([20261123, 7])
    force = rng.uniform(3.0, 15.0, N)
    read = exponent * np.log(force) + 0.02 * rng.standard_normal(N)
    stated = stated(force)
    slope, offset = np.polyfit(np.log(stated), read, 1)
    arm, nowhere = Arm.single_patch(grid(4, 4, 0.01)), np.zeros(N)
    table = PressTable(
        arm=arm, patch=np.zeros(N, np.intp), s=nowhere, a=nowhere, force=stated, pressures=np.zeros((N, 16))
    )
    found = HeldOutErrors(
        inside=np.ones(N, np.bool_),
        uv=np.zeros((N, 2)),
        sd=np.full(N, 1e-4),
        force=np.exp((read - offset) / slope),
        misfit=0.01,
    )
    return uneven_forces(table, found, slope)


@pytest.mark.parametrize("exponent", [0.8, 1.0, 1.2])
def test_forces_that_go_with_the_readings_by_a_power_law_are_not_named(exponent):
    assert not named(exponent, lambda force: 1.4 * force)
    assert not named(exponent, lambda force: force * np.random.default_rng(9).normal(1.0, 0.05, N))


@pytest.mark.parametrize("first", [12, 41])
def test_another_scale_from_some_row_on_is_named_with_it(first):
    ((what, row),) = named(1.0, lambda force: force * np.where(np.arange(N) < first, 1.0, 1.3))
    assert row == first
    assert float(re.search(r"there on (\S+) times", what).group(1)) == pytest.approx(1.3, abs=0.03)


@pytest.mark.parametrize(("tare", "words"), [(-2.0, "were added to"), (4.0, "were taken off")])
def test_a_tare_is_named_with_its_size(tare, words):
    ((what, row),) = named(1.0, lambda force: force + tare)
    assert row is None
    assert words in what
    assert float(re.search(r"if (\S+) N", what).group(1)) == pytest.approx(abs(tare), rel=0.25)
