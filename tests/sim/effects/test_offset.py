"""offset: zeros that scatter and stay."""

import numpy as np

from skinbus.sim.effects.offset import Offset


def test_zeros_scatter_as_their_parameter_says(apply):
    zeros = np.concatenate([apply(Offset(sigma_pa=300.0), 0.0, [0.0], seed=s)[0] for s in range(20)])
    assert abs(zeros.mean()) < 4 * 300 / np.sqrt(len(zeros))
    assert abs(zeros.std() / 300 - 1.0) < 4 / np.sqrt(2 * len(zeros))


def test_zero_is_the_same_in_every_sample_and_under_any_load(apply):
    out = apply(Offset(), np.array([[0.0], [0.0], [1e5]]), [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(out[0], out[1])
    np.testing.assert_allclose(out[2] - 1e5, out[0], atol=1e-9)
