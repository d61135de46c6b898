"""The noise of a board is that of single readings, whatever presses were averaged over."""

from dataclasses import replace

import numpy as np

from skinbus.estimate import Estimator, learn_radial_law
from skinbus.estimate.calibration.table import PressTable, mean_and_noise
from skinbus.estimate.calibration.validation import PLACE_SD, single_noise
from skinbus.model import Arm, Radial
from skinbus.model.patch import grid

SEED = 20261127
NOISE = 200.0
LAW = Radial(400e-6, 13000.0 * np.exp(-((np.arange(64) / 20.0) ** 2)))
MEANS = 16


def test_noise_is_that_which_a_file_says_of_single_readings_or_else_at_least_the_declared_one():
    """Presses are means of many cycles, and show less; with their noise contacts are found in none."""
    rng = np.random.default_rng(SEED)
    arm = Arm.single_patch(grid(4, 4, 0.010), law=LAW, noise=NOISE)
    s, a = rng.uniform(-0.02, 0.02, (2, 60))
    truth = LAW.pressure(arm.distance(slice(None), s, a), 5.0)
    cycles = truth[:, None] + NOISE * rng.standard_normal((60, MEANS, 16))
    mean, noise = (np.array(x) for x in zip(*map(mean_and_noise, cycles), strict=True))
    patch, force = np.zeros(60, np.intp), np.full(60, 5.0)
    table = PressTable(arm=arm, patch=patch, s=s, a=a, force=force, pressures=mean, noise=noise)
    learned = learn_radial_law(arm, s, a, force, mean, place_sd=PLACE_SD, maps=False)
    assert np.median(learned.noise) < 0.5 * NOISE
    single = single_noise(table, learned)
    assert np.abs(single / NOISE - 1.0).max() < 0.15
    assert (single_noise(replace(table, noise=None), learned) >= NOISE).all()
    estimator = Estimator(replace(learned, noise=single).apply(arm), "fit")
    assert not any(len(estimator.update(NOISE * rng.standard_normal(16), k)) for k in range(100))


def test_missing_readings_are_left_out_of_means():
    mean, noise = mean_and_noise(np.array([[1.0, np.nan, np.nan], [3.0, 5.0, np.nan]]))
    np.testing.assert_array_equal(mean, [2.0, 5.0, np.nan])
    np.testing.assert_array_equal(noise, [np.sqrt(2.0), np.nan, np.nan])
