"""thermal: zeros and gains follow the temperatures of the boards, touched or not."""

import numpy as np

from skinbus.sim.effects.thermal import Thermal

ALIKE = {"board_sigma_c": 0.0, "zero_sigma_pa_per_k": 0.0}


def test_ten_degrees_change_gain_and_zero_by_ten_times_their_coefficients(apply, pad):
    out = apply(Thermal(end_c=10.0, tau_s=0.0, **ALIKE), 1e4, [0.0, 50.0], arm=pad)
    np.testing.assert_allclose(out, 1e4 * 1.036 + 1700.0)


def test_warm_up_has_its_time_constant(apply, pad):
    t = np.array([0.0, 300.0, 600.0, 1e5])
    effect = Thermal(start_c=-5.0, end_c=15.0, tau_s=600.0, zero_pa_per_k=0.0, **ALIKE)
    out = apply(effect, 1e4, t, arm=pad)[:, 0]
    degrees = 15.0 - 20.0 * np.exp(-t / 600.0)
    np.testing.assert_allclose(out, 1e4 * (1.0 + 0.0036 * degrees))
    assert out[0] == 1e4 * (1.0 - 0.0036 * 5.0)


def test_boards_differ_as_wholes_and_tactels_by_their_own_coefficients(apply, forearm):
    out = apply(Thermal(tau_s=0.0, zero_sigma_pa_per_k=0.0), 0.0, [1.0])[0]
    boards = np.array([out[forearm.tactels_of(p)] for p in range(forearm.n_patches)])
    assert np.ptp(boards, axis=1).max() < 1e-9
    assert boards[:, 0].std() > 100.0
    out = apply(Thermal(tau_s=0.0, board_sigma_c=0.0), 0.0, [1.0])[0]
    assert abs(out.mean() - 1700.0) < 30.0
    assert abs(out.std() / 200.0 - 1.0) < 0.15
