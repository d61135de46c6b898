"""Counts to pressure and back: half a step at most, saturation, the widths of CiA 401."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.model import Transducer

WIDTHS = [(16, 0x7FFF), (8, 0x7F)]


@pytest.mark.parametrize(("bits", "full"), WIDTHS)
def test_full_scale_is_the_largest_count(bits, full):
    transducer = Transducer(full_scale=250e3, bits=bits)
    assert transducer.full_counts == full
    assert transducer.counts(250e3) == full
    assert transducer.pressure(full) == pytest.approx(250e3)
    assert transducer.counts(0.0) == 0


@pytest.mark.parametrize(("bits", "full"), WIDTHS)
def test_what_does_not_fit_saturates_and_nan_reads_as_zero(bits, full):
    counts = Transducer(full_scale=250e3, bits=bits).counts([1e9, -1e9, np.inf, -np.inf, np.nan])
    assert list(counts) == [full, -full - 1, full, -full - 1, 0]


@given(st.sampled_from([8, 16]), st.floats(1e3, 1e7), st.floats(-1.0, 1.0))
def test_pressure_comes_back_within_half_a_step(bits, full_scale, share):
    transducer = Transducer(full_scale=full_scale, bits=bits)
    pressure = share * full_scale
    back = transducer.pressure(transducer.counts(pressure))
    assert abs(back - pressure) <= 0.5 * transducer.step * (1 + 1e-9)


def test_converter_coarser_than_its_readings_is_left_adjusted_in_them():
    fine = Transducer(full_scale=250e3)
    transducer = Transducer(full_scale=250e3, converter_bits=12)
    assert transducer.counts([1e9, -1e9]).tolist() == [0x7FF0, -0x8000]
    assert (transducer.counts(np.linspace(-250e3, 250e3, 999)) % 16 == 0).all()
    assert transducer.pressure(0x4000) == fine.pressure(0x4000), "what a count means is not the converter's"
    pressures = np.linspace(-249e3, 249e3, 999)
    error = transducer.pressure(transducer.counts(pressures)) - pressures
    assert np.abs(error).max() <= 0.5 * transducer.resolution * (1 + 1e-9)


def test_converter_finer_than_its_readings_shows_the_steps_of_the_readings():
    assert Transducer(full_scale=250e3, bits=8, converter_bits=12).resolution == 250e3 / 127
