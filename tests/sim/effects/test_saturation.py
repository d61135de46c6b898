"""saturation: a ceiling, and nothing below it."""

import numpy as np

from skinbus.sim.effects.saturation import Saturation


def test_readings_stop_at_the_limit_and_are_exact_below(apply, pad):
    p = np.linspace(-1e4, 3e5, 16)
    out = apply(Saturation(limit_kpa=150.0), p, [0.0], arm=pad)[0]
    np.testing.assert_array_equal(out, np.minimum(p, 150e3))
    assert (out == 150e3).any()
