"""temperature: sensitivity follows the warm-up."""

import numpy as np

from skinbus.sim.effects.temperature import Temperature


def test_ten_degrees_change_the_reading_by_ten_times_the_coefficient(apply, pad):
    out = apply(Temperature(end_c=10.0, tau_s=0.0), 1e4, [0.0, 50.0], arm=pad)
    np.testing.assert_allclose(out, 1e4 * 1.036)


def test_warm_up_has_its_time_constant(apply, pad):
    t = np.array([0.0, 300.0, 600.0, 1e5])
    out = apply(Temperature(start_c=-5.0, end_c=15.0, tau_s=600.0), 1e4, t, arm=pad)[:, 0]
    degrees = 15.0 - 20.0 * np.exp(-t / 600.0)
    np.testing.assert_allclose(out, 1e4 * (1.0 + 0.0036 * degrees))
    assert out[0] == 1e4 * (1.0 - 0.0036 * 5.0)
