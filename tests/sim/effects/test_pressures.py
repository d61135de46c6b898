"""Every effect by itself: what effects make of pressures and counts."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import kstest

from skinbus.sim.effects.readings import (
    Adc,
    Bend,
    Burst,
    Crosstalk,
    Dead,
    Drift,
    GainSpread,
    Hysteresis,
    Noise,
    Offset,
    Piezoresistive,
    Stuck,
    Thermal,
    Viscoelastic,
    lines_of,
)

# --- bend: preload where a flat board stands off a curved link.


def test_preload_is_stiffness_times_stand_off(apply, forearm):
    out = apply(Bend(kpa_per_mm=0.5), 0.0, [0.0])[0]
    surface = forearm.links[0].surface
    radius = float(forearm.links[0].surface.radius)
    w = np.array([-15, -5, 5, 15]) * 1e-3
    wanted = 0.5e6 * w**2 / (2 * radius)
    for p in range(forearm.n_patches):
        around = surface.wrap(forearm.tactel_a[forearm.tactels_of(p)] - forearm.patch_a[p])
        assert_allclose(out[forearm.tactels_of(p)], 0.5e6 * around**2 / (2 * radius), atol=1e-6)
    assert_allclose(np.unique(np.round(out, 3)), np.unique(np.round(wanted, 3)))


# --- viscoelastic: relaxation and creep of a standard linear solid, with its time constants.


T = np.arange(0.0, 6.0, 1e-3)


def test_pressure_relaxes_under_held_position(apply, pad):
    effect = Viscoelastic(relaxation=0.3, tau_s=0.8, control="position")
    out = apply(effect, 1000.0, T, arm=pad)[:, 0]
    assert_allclose(out, 1000.0 * (1.0 - 0.3 * (1.0 - np.exp(-T / 0.8))), rtol=1e-9)


def test_reading_creeps_under_held_force(apply, pad):
    out = apply(Viscoelastic(relaxation=0.2, tau_s=0.8), 1000.0, T, arm=pad)[:, 0]
    tau = 0.8 / 0.8
    assert_allclose(out, 1000.0 * (1.0 + 0.25 * (1.0 - np.exp(-T / tau))), rtol=1e-9)


# --- hysteresis: the width of the loop.


def test_loop_is_as_wide_as_its_parameter_and_closes_at_zero(apply, pad):
    up = np.linspace(0.0, 1e5, 2001)
    p = np.concatenate([up, up[::-1]])[:, None]
    out = apply(Hysteresis(loop=0.045), p, np.arange(len(p)) * 0.01, arm=pad)[:, 0]
    rising, falling = out[:2001], out[2001:][::-1]
    half = np.searchsorted(up, 5e4)
    assert abs((falling[half] - rising[half]) / up[half] - 0.045) < 1e-6
    assert out[-1] == 0.0
    assert_allclose(0.5 * (falling[:half] + rising[:half]), up[:half], rtol=1e-9)


# --- gain_spread, offset, noise: normally distributed, fixed for the run or new for each sample.


@pytest.mark.parametrize(
    ("effect", "given", "mean", "sigma", "is_fixed"),
    [
        (GainSpread(sigma=0.05), 1.0, 1.0, 0.05, True),
        (Offset(sigma_pa=300.0), 0.0, 0.0, 300.0, True),
        (Noise(sigma_pa=150.0), 1000.0, 1000.0, 150.0, False),
    ],
)
def test_values_scatter_normally_as_their_parameter_says(apply, effect, given, mean, sigma, is_fixed):
    drawn = np.array([apply(effect, given, [0.0, 1.0], seed=s) for s in range(20)]) - mean
    n = drawn[:, 0].size
    assert (drawn[:, 0] == drawn[:, 1]).all() == is_fixed
    assert abs(drawn[:, 0].mean()) < 4 * sigma / np.sqrt(n)
    assert abs(drawn[:, 0].std() / sigma - 1.0) < 4 / np.sqrt(2 * n)
    assert kstest(drawn[:, 0].ravel() / sigma, "norm").pvalue > 1e-3
    if not is_fixed:
        assert abs((drawn[:, 0] * drawn[:, 1]).mean()) < 4 * sigma**2 / np.sqrt(n)


# --- piezoresistive: the curve of a divider, right at zero and at full scale.


def test_divider_is_the_voltage_over_its_load_resistor(apply, pad):
    full = 250e3
    p = np.linspace(0.0, full, 101)
    out = apply(Piezoresistive(load_ratio=0.5, linearity=0.0), p[:, None], np.zeros(101), arm=pad)
    # 5 V over tactel and load resistor; the tactel has 10 kOhm at full scale, the load half of it
    with np.errstate(divide="ignore"):
        resistance = 10e3 * full / p
    volts = 5.0 * 5e3 / (5e3 + resistance)
    assert_allclose(out[:, 0], full * volts / volts[-1], rtol=1e-12, atol=1e-9)


# --- thermal: zeros and gains follow the temperatures of the boards, touched or not.


ALIKE = {"board_sigma_c": 0.0, "zero_sigma_pa_per_k": 0.0}


def test_warm_up_has_its_time_constant(apply, pad):
    t = np.array([0.0, 300.0, 600.0, 1e5])
    effect = Thermal(start_c=-5.0, end_c=15.0, tau_s=600.0, zero_pa_per_k=0.0, **ALIKE)
    out = apply(effect, 1e4, t, arm=pad)[:, 0]
    degrees = 15.0 - 20.0 * np.exp(-t / 600.0)
    assert_allclose(out, 1e4 * (1.0 + 0.0036 * degrees))
    assert out[0] == 1e4 * (1.0 - 0.0036 * 5.0)


# --- drift: a straight line over the logarithm of time.


def test_reading_gains_its_share_in_every_decade(apply, pad):
    t = np.concatenate([[0.0], np.logspace(-1, 4.5, 300)])
    out = apply(Drift(per_decade=0.05, first_s=1.0), 1e4, t, arm=pad)[:, 0]
    wanted = 1e4 * (1.0 + 0.05 * np.log10(1.0 + t))
    late = (t >= 10.0) & (t <= 1e4)
    assert np.abs(out - wanted)[late].max() < 0.05 * 0.05 * 1e4, "5 % of one decade's drift"
    assert np.abs(out - wanted)[t <= 1e4].max() < 0.25 * 0.05 * 1e4
    decades = np.interp([10.0, 100.0, 1e3, 1e4], t, out)
    assert_allclose(np.diff(decades), 500.0, rtol=0.08)


# --- dead: the right tactels, from the right time on.


def test_named_tactels_read_nothing_from_their_time_on(apply, forearm):
    effect = Dead(tactels=((1, 1), (3, 16)), share=0.0, from_s=2.0)
    out = apply(effect, 1e4, [0.0, 1.99, 2.0, 5.0])
    assert (out[:2] == 1e4).all()
    for row in out[2:]:
        assert np.flatnonzero(row == 0.0).tolist() == [0, 2 * 16 + 15]


def test_tactels_that_the_arm_does_not_have_are_faults(forearm):
    faults = [str(f) for f in Dead(tactels=((99, 1), (1, 17), (1, 0), (1, 16))).check(forearm)]
    assert len(faults) == 3
    assert "node-IDs of arm forearm" in faults[0]
    assert "a tactel of 1 to 16" in faults[1]


# --- crosstalk: shares of the others in the row and in the column, and nothing from other boards.


def test_it_is_the_matrix_it_says(apply, forearm):
    rng = np.random.default_rng(5)
    p = 1e4 * rng.random(forearm.n_tactels)
    rows, columns = lines_of(forearm)
    others = ~np.eye(forearm.n_tactels, dtype=bool)
    matrix = 0.03 * ((rows[:, None] == rows) & others) + 0.01 * ((columns[:, None] == columns) & others)
    out = apply(Crosstalk(row=0.03, column=0.01), p, [0.0])[0]
    assert_allclose(out, p + matrix @ p, rtol=1e-12)


# --- burst: spikes that neighbours and successive samples share.


@pytest.mark.slow
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
        assert_allclose(near, np.exp(-0.5 * (10.0 / 12.0) ** 2), rtol=1e-6)


# --- adc: steps of the right width, inside the range, left-adjusted.


@pytest.mark.parametrize("bits", [8, 10, 12, 14])
def test_counts_are_the_nearest_multiples_of_one_step(apply, pad, bits):
    counts = np.linspace(-32768, 32767, 4096).astype(np.int32).reshape(-1, 16)
    out = apply(Adc(bits=bits), counts, np.zeros(len(counts)), arm=pad, dtype=np.int32)
    width = 1 << (16 - bits)
    assert not (out % width).any()
    inside = counts <= 0x7FFF // width * width
    assert np.abs(out - counts)[inside].max() <= width // 2
    assert out.max() == 0x7FFF // width * width, "CiA 401: full scale is left-adjusted, below it zeros"
    assert out.min() == -0x8000


def test_range_clips_below_full_scale(apply, pad):
    counts = np.full((1, 16), 30000, np.int32)
    out = apply(Adc(bits=16, range_kpa=100.0), counts, [0.0], arm=pad, dtype=np.int32)
    assert (out == round(100e3 / pad.patches[0].patch.transducer.step)).all()


# --- stuck: readings freeze at what they were.


def test_named_tactels_repeat_the_reading_of_their_time(apply, pad):
    counts = np.arange(6, dtype=np.int32)[:, None] * 100 + np.arange(16)
    effect = Stuck(tactels=((1, 4),), share=0.0, from_s=2.0)
    out = apply(effect, counts, np.arange(6.0), arm=pad, dtype=np.int32)
    assert_array_equal(out[:, 3], [3, 103, 203, 203, 203, 203])
    others = np.delete(np.arange(16), 3)
    assert_array_equal(out[:, others], counts[:, others])
