"""Clocks are joined by what the skin and the other instrument have in common, and holds are found."""

import numpy as np
import pytest

from skinbus.estimate.calibration.recording import find_holds, find_offset, load_of

SEED = 20261124


def pressed(rng, n=25):
    """Return begins and ends (n,) s and forces (n,) N of presses at uneven times."""
    gaps, lengths = rng.uniform(0.4, 1.2, n), rng.uniform(0.4, 0.9, n)
    end = np.cumsum(gaps + lengths)
    return end - lengths, end, rng.uniform(3.0, 12.0, n)


def force_at(t, begin, end, newton):
    ramp = np.clip(np.minimum(t[:, None] - begin, end - t[:, None]) / 0.05, 0.0, 1.0)
    return (ramp * newton).sum(axis=1)


@pytest.mark.parametrize("shift", [-7.3, 0.012, 41.7])
def test_offset_of_a_force_sensor_is_found(shift):
    rng = np.random.default_rng(SEED)
    presses = pressed(rng)
    # the skin was recorded long before the sensor was
    t, t_force = np.arange(-12.0, 45.0, 0.01), np.arange(0.0, 43.0, 0.0113)
    load = 2e4 * force_at(t, *presses) ** 0.9 + 500.0 * rng.standard_normal(len(t))
    force = force_at(t_force, *presses) + 0.2 * rng.standard_normal(len(t_force))
    found = find_offset(t, load, t_force - shift, force)
    assert found.correlation > 0.9
    assert abs(found.s - shift) < 0.008


def test_holds_are_found_on_an_arm_of_many_boards_in_their_noise():
    rng = np.random.default_rng(SEED + 3)
    begin, end, newton = pressed(rng)
    t = np.arange(0.0, 50.0, 0.02)
    pressures = 200.0 * rng.standard_normal((len(t), 384)) + 80.0 * rng.standard_normal(384)
    shares = np.array([0.4, 0.3, 0.2, 0.1])
    pressures[:, 200:204] += 8e3 * force_at(t, begin, end, newton)[:, None] * shares
    holds = find_holds(t, load_of(pressures, np.full(384, 1000.0)))
    assert len(holds) == len(begin)
    for hold, b, e in zip(holds, begin, end, strict=True):
        assert b + 0.04 <= hold.begin < hold.end <= e - 0.04


def test_signals_without_a_press_are_refused():
    t = np.arange(0.0, 10.0, 0.01)
    with pytest.raises(ValueError, match="without a press"):
        find_offset(t, np.zeros(len(t)), t, np.ones(len(t)))
