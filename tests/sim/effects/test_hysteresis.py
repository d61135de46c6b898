"""hysteresis: the width of the loop, whatever the rate."""

import numpy as np

from skinbus.sim.effects.hysteresis import Hysteresis


def loop(apply, pad, n):
    up = np.linspace(0.0, 1e5, n)
    p = np.concatenate([up, up[::-1]])[:, None]
    return up, apply(Hysteresis(loop=0.045), p, np.arange(2 * n) * 0.01, arm=pad)[:, 0]


def test_loop_is_as_wide_as_its_parameter_and_closes_at_zero(apply, pad):
    up, out = loop(apply, pad, 2001)
    rising, falling = out[:2001], out[2001:][::-1]
    half = np.searchsorted(up, 5e4)
    assert abs((falling[half] - rising[half]) / up[half] - 0.045) < 1e-6
    assert out[-1] == 0.0
    np.testing.assert_allclose(0.5 * (falling[:half] + rising[:half]), up[:half], rtol=1e-9)


def test_rate_does_not_matter(apply, pad):
    _, fast = loop(apply, pad, 101)
    _, slow = loop(apply, pad, 1001)
    np.testing.assert_allclose(slow[:1001:10], fast[:101], rtol=1e-12)


def test_small_movements_inside_the_loop_are_not_read(apply, pad):
    p = np.array([1e4, 5e4, 4.95e4, 5e4, 4.95e4])[:, None]
    out = apply(Hysteresis(loop=0.045), p, np.arange(5.0), arm=pad)[:, 0]
    assert out[1] == out[2] == out[3] == out[4]
