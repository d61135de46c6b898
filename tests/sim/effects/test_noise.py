"""noise: white, of the right size, independent."""

import numpy as np
from scipy.stats import kstest

from skinbus.sim.effects.noise import Noise


def test_mean_variance_and_shape_are_those_of_white_noise(apply, forearm):
    out = apply(Noise(sigma_pa=150.0), 1000.0, np.arange(200) * 0.02) - 1000.0
    n = out.size
    assert abs(out.mean()) < 4 * 150 / np.sqrt(n)
    assert abs(out.std() / 150 - 1.0) < 4 / np.sqrt(2 * n)
    assert kstest(out[:, ::20].ravel() / 150, "norm").pvalue > 1e-3


def test_samples_and_tactels_are_uncorrelated(apply, forearm):
    out = apply(Noise(sigma_pa=1.0), 0.0, np.arange(400) * 0.02)
    n = 399 * forearm.n_tactels
    assert abs((out[1:] * out[:-1]).mean()) < 4 / np.sqrt(n)
    assert abs((out[:, 1:] * out[:, :-1]).mean()) < 4 / np.sqrt(n)
