"""flicker: a density that falls as one over the frequency, of the right size."""

import numpy as np
import pytest
from scipy.signal import welch

from skinbus.sim.effects.flicker import Flicker

RATE = 200.0


@pytest.fixture(scope="module")
def density(apply, forearm):
    t = np.arange(2**14) / RATE
    out = apply(Flicker(pa_at_1hz=50.0), 0.0, t)
    f, s = welch(out, RATE, nperseg=2**13, axis=0, detrend=False)
    return f, s.mean(axis=1)


@pytest.mark.slow
def test_density_is_one_over_f_over_two_decades(density):
    f, s = density
    band = (f > 0.1) & (f < 10.0)
    slope = np.polyfit(np.log(f[band]), np.log(s[band]), 1)[0]
    assert abs(slope + 1.0) < 0.06


def test_density_at_one_hertz_is_the_parameter(density):
    f, s = density
    near = (f > 0.7) & (f < 1.4)
    assert np.sqrt((s * f)[near].mean()) == pytest.approx(50.0, rel=0.06)


def test_tactels_are_independent(apply):
    out = apply(Flicker(), 0.0, np.arange(400) * 0.5)
    corr = np.corrcoef(out.T[:40])
    assert np.abs(corr - np.eye(40)).mean() < 0.35, "slow noise has few independent samples"


def test_scene_that_begins_anew_does_not_freeze_it(apply):
    times = np.concatenate([np.arange(0, 40.0, 0.5), np.arange(0, 40.0, 0.5)])
    out = apply(Flicker(), 0.0, times)
    assert np.ptp(out[85:], axis=0).min() > 0.0
    assert np.std(out[85:]) > 0.5 * np.std(out[:80])


def test_rate_of_sampling_does_not_change_the_variance(apply):
    fast = np.var(apply(Flicker(high_hz=5.0), 0.0, np.arange(200) * 0.002))
    slow = np.var(apply(Flicker(high_hz=5.0), 0.0, np.arange(200) * 0.2))
    assert fast == pytest.approx(slow, rel=0.15)
