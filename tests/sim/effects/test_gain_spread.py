"""gain_spread: factors about one, fixed for the run."""

import numpy as np

from skinbus.sim.effects.gain_spread import GainSpread


def test_factors_scatter_about_one_as_their_parameter_says(apply, forearm):
    gains = np.concatenate([apply(GainSpread(sigma=0.05), 1.0, [0.0], seed=s)[0] for s in range(20)])
    assert abs(gains.mean() - 1.0) < 4 * 0.05 / np.sqrt(len(gains))
    assert abs(gains.std() / 0.05 - 1.0) < 4 / np.sqrt(2 * len(gains))


def test_each_tactel_keeps_its_factor(apply):
    out = apply(GainSpread(), np.array([[1.0], [5.0], [1000.0]]), [0.0, 1.0, 2.0])
    np.testing.assert_allclose(out[2] / out[0], 1000.0)
    np.testing.assert_allclose(out[1] / out[0], 5.0)
