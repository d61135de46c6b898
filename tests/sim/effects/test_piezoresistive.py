"""piezoresistive: the curves of divider and amplifier, right at zero and at full scale."""

import numpy as np
import pytest

from skinbus.sim.effects.piezoresistive import Piezoresistive

FULL = 250e3


def curve(apply, pad, **parameters):
    p = np.linspace(0.0, FULL, 101)
    return p, apply(Piezoresistive(**parameters), p[:, None], np.zeros(101), arm=pad)


def test_divider_is_the_voltage_over_its_load_resistor(apply, pad):
    p, out = curve(apply, pad, load_ratio=0.5, linearity=0.0)
    # 5 V over tactel and load resistor; the tactel has 10 kOhm at full scale, the load half of it
    with np.errstate(divide="ignore"):
        resistance = 10e3 * FULL / p
    volts = 5.0 * 5e3 / (5e3 + resistance)
    np.testing.assert_allclose(out[:, 0], FULL * volts / volts[-1], rtol=1e-12, atol=1e-9)


def test_inverting_amplifier_is_linear(apply, pad):
    p, out = curve(apply, pad, circuit="inverting", load_ratio=0.5, linearity=0.0)
    np.testing.assert_array_equal(out[:, 3], p)


def test_bend_stays_within_the_linearity_and_differs_between_tactels(apply, forearm):
    p = np.linspace(0.0, FULL, 51)
    effect = Piezoresistive(circuit="inverting", linearity=0.03)
    error = (apply(effect, p[:, None], np.zeros(51)) - p[:, None]) / FULL
    worst = np.abs(error).max(axis=0)
    assert worst.max() <= 0.03
    assert worst.mean() == pytest.approx(0.015, rel=0.1), "uniform between -3 % and 3 %"
    np.testing.assert_allclose(error[[0, -1]], 0.0, atol=1e-12)


def test_no_pressure_reads_none(apply, pad):
    _, out = curve(apply, pad)
    assert not out[0].any()
