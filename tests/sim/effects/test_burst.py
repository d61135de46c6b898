"""burst: spikes that neighbours and successive samples share."""

import numpy as np

from skinbus.sim.effects.burst import Burst


def test_bursts_come_at_their_rate_on_every_board(apply, forearm):
    t = np.arange(0.0, 600.0, 0.02)
    out = apply(Burst(per_minute=6.0, duration_ms=5.0), 0.0, t)
    boards = np.array([np.abs(out[:, forearm.tactels_of(p)]).max(axis=1) for p in range(forearm.n_patches)])
    begins = (np.diff((boards > 0.0).astype(int), axis=1) == 1).sum()
    expected = 6.0 * 10.0 * forearm.n_patches
    assert abs(begins - expected) < 5.0 * np.sqrt(expected)


def test_neighbours_share_a_burst_with_one_sign_and_farther_ones_less(apply, pad):
    t = np.arange(0.0, 60.0, 0.002)
    out = apply(Burst(per_minute=60.0, radius_mm=12.0, duration_ms=15.0), 0.0, t, arm=pad)
    struck = np.abs(out).max(axis=1) > 5e3
    assert struck.any()
    for row in out[struck]:
        strongest = np.abs(row).argmax()
        away = np.hypot(pad.tactel_s - pad.tactel_s[strongest], pad.tactel_a - pad.tactel_a[strongest])
        near = row[(away > 0.0) & (away < 0.0101)] / row[strongest]
        np.testing.assert_allclose(near, np.exp(-0.5 * (10.0 / 12.0) ** 2), rtol=1e-6)


def test_burst_falls_to_1_over_e_in_its_duration(apply, pad):
    t = np.arange(0.0, 20.0, 0.001)
    out = np.abs(apply(Burst(per_minute=60.0, duration_ms=15.0), 0.0, t, arm=pad)).max(axis=1)
    k = int(np.flatnonzero((out[:-1] == 0.0) & (out[1:] > 0.0))[0]) + 1
    np.testing.assert_allclose(out[k + 15] / out[k], np.exp(-1.0), rtol=1e-6)
