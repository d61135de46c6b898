"""drift: a straight line over the logarithm of time."""

import numpy as np

from skinbus.sim.effects.drift import Drift


def test_reading_gains_its_share_in_every_decade(apply, pad):
    t = np.concatenate([[0.0], np.logspace(-1, 4.5, 300)])
    out = apply(Drift(per_decade=0.05, first_s=1.0), 1e4, t, arm=pad)[:, 0]
    wanted = 1e4 * (1.0 + 0.05 * np.log10(1.0 + t))
    late = (t >= 10.0) & (t <= 1e4)
    assert np.abs(out - wanted)[late].max() < 0.05 * 0.05 * 1e4, "5 % of one decade's drift"
    assert np.abs(out - wanted)[t <= 1e4].max() < 0.25 * 0.05 * 1e4
    decades = np.interp([10.0, 100.0, 1e3, 1e4], t, out)
    np.testing.assert_allclose(np.diff(decades), 500.0, rtol=0.08)


def test_drift_recovers_after_the_load(apply, pad):
    t = np.concatenate([np.linspace(0.0, 1000.0, 1001), np.linspace(1001.0, 21000.0, 2001)])
    load = np.where(t <= 1000.0, 1e4, 0.0)[:, None]
    out = apply(Drift(), load, t, arm=pad)[:, 0]
    gained = out[1000] - 1e4
    assert 0.0 < out[1001] < 1.02 * gained
    assert out[-1] < 0.1 * gained


def test_drift_is_in_proportion_to_the_load(apply, pad):
    t = np.logspace(-1, 3, 50)
    np.testing.assert_allclose(
        apply(Drift(), 5e4, t, arm=pad), 5.0 * apply(Drift(), 1e4, t, arm=pad), rtol=1e-12
    )
