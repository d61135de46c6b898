"""The noise of a board is that of single readings, whatever presses were averaged over."""

from dataclasses import replace

import numpy as np
import pytest

from skinbus.estimate import Estimator, learn_radial_law
from skinbus.estimate.calibration.table import PressTable, mean_and_noise
from skinbus.estimate.calibration.validation import PLACE_SD, single_noise
from skinbus.model import Arm, Radial
from skinbus.model.patch import grid

SEED = 20261127
NOISE = 200.0
LAW = Radial(400e-6, 13000.0 * np.exp(-((np.arange(64) / 20.0) ** 2)))
MEANS = 16


@pytest.fixture(scope="module")
def pressed():
    """Presses on a board of this law, each the mean of many cycles."""
    rng = np.random.default_rng(SEED)
    arm = Arm.single_patch(grid(4, 4, 0.010), law=LAW, noise=NOISE)
    placed = arm.patches[0]
    s, a = placed.s + rng.uniform(-0.02, 0.02, 60), placed.a + rng.uniform(-0.02, 0.02, 60)
    d = arm.distance(slice(None), s, a)
    truth = LAW.pressure(d, 5.0)
    cycles = truth[:, None] + NOISE * rng.standard_normal((60, MEANS, 16))
    mean, noise = (np.array(x) for x in zip(*map(mean_and_noise, cycles), strict=True))
    return PressTable(
        arm=arm,
        patch=np.zeros(60, np.intp),
        s=s,
        a=a,
        force=np.full(60, 5.0),
        pressures=mean,
        noise=noise,
    )


@pytest.fixture(scope="module")
def learned(pressed):
    made = (pressed.arm, pressed.s, pressed.a, pressed.force, pressed.pressures)
    return learn_radial_law(*made, place_sd=PLACE_SD, maps=False)


def n_false(arm):
    """Contacts in a hundred cycles in which nothing presses."""
    rng, estimator = np.random.default_rng(SEED + 1), Estimator(arm, "fit")
    quiet = NOISE * rng.standard_normal((100, 16))
    return sum(len(estimator.update(row, k)) for k, row in enumerate(quiet))


def test_what_a_file_says_of_single_readings_is_their_noise(pressed, learned):
    assert np.median(learned.noise) < 0.5 * NOISE
    noise = single_noise(pressed, learned)
    assert np.abs(noise / NOISE - 1.0).max() < 0.15
    assert n_false(replace(learned, noise=noise).apply(pressed.arm)) == 0


def test_of_means_without_it_the_noise_is_at_least_the_declared_one(pressed, learned):
    noise = single_noise(replace(pressed, noise=None), learned)
    assert (noise >= NOISE).all()


def test_missing_readings_are_left_out_of_means():
    mean, noise = mean_and_noise(np.array([[1.0, np.nan, np.nan], [3.0, 5.0, np.nan]]))
    np.testing.assert_array_equal(mean, [2.0, 5.0, np.nan])
    np.testing.assert_array_equal(noise, [np.sqrt(2.0), np.nan, np.nan])
