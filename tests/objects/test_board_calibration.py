"""A calibration in a DCF: written, read back by describe_patch, and used by an arm file."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skinbus.model import Cone, Radial, ResidualMap
from skinbus.objects.board import calibration_values, decode_map, describe_patch
from skinbus.objects.dcf import write_dcf
from skinbus.objects.eds import load_eds

REAL32 = 1e-7
"""Values are stored with 24 bits."""

GAIN = np.linspace(0.9, 1.1, 16)
NOISE = np.linspace(50.0, 150.0, 16)
TABLE = 13000.0 * np.exp(-((np.arange(64) / 20.0) ** 2))


def stored(folder, **calibration):
    """Write a calibration into a DCF; return the patch that is read from it."""
    values = calibration_values(load_eds("skin-patch", 1), gain=GAIN, noise=NOISE, **calibration)
    write_dcf("skin-patch", folder / "mine.dcf", values)
    return describe_patch(load_eds(folder / "mine.dcf", 1))


@pytest.mark.parametrize("law", [Radial(312e-6, TABLE, 0.85, 0.04), Cone(3.5e6, 0.9, 0.2)])
def test_calibration_goes_into_a_dcf_and_comes_back(law, tmp_path):
    patch = stored(tmp_path, law=law)
    assert_allclose(patch.gain, GAIN, rtol=REAL32)
    assert_allclose(patch.noise, NOISE, rtol=REAL32)
    assert type(patch.law) is type(law)
    assert patch.law.exponent == pytest.approx(law.exponent, rel=REAL32)
    assert patch.law.misfit == pytest.approx(law.misfit, rel=REAL32)
    d = np.linspace(0.0, 0.02, 50)
    assert_allclose(patch.law.pressure(d, 5.0), law.pressure(d, 5.0), rtol=1e-6, atol=1e-3)


def test_step_is_rounded_to_micrometres_and_the_table_follows(tmp_path):
    law = Radial(312.4e-6, TABLE)
    read = stored(tmp_path, law=law).law
    d = np.linspace(0.0, 0.019, 200)
    assert_allclose(read.profile(d), law.profile(d), atol=1e-4 * TABLE[0])


def test_table_longer_than_the_dictionary_is_refused():
    with pytest.raises(ValueError, match="room for 64"):
        calibration_values(load_eds("skin-patch", 1), law=Radial(1e-4, np.ones(65)), gain=GAIN, noise=NOISE)


def test_response_goes_into_a_dcf_and_comes_back(tmp_path):
    rng = np.random.default_rng(3)
    law = Radial(312e-6, TABLE, 0.85, 0.04, 0.01 * TABLE[::-1], 7.5)
    width, bias = rng.uniform(0.9, 1.1, 16), rng.uniform(-50.0, 50.0, 16)
    found = ResidualMap(2e-3, rng.uniform(-100.0, 100.0, (16, 19, 19)))
    patch = stored(tmp_path, law=law, width=width, bias=bias, residual_map=found)
    assert_allclose(patch.width, width, rtol=REAL32)
    assert_allclose(patch.bias, bias, rtol=REAL32)
    assert_allclose(patch.law.misfit_profile, law.misfit_profile, rtol=1e-6)
    assert patch.law.typical_force == 7.5
    assert patch.residual_map.step == pytest.approx(2e-3)
    assert_allclose(patch.residual_map.values, found.values, atol=0.5 * 100.0 / 127.0)


@pytest.mark.parametrize("data", [b"\x01", bytes(8), b"\x10\x03\x00\x00" + bytes(4) + bytes(143)])
def test_bytes_that_are_no_residual_map_are_refused(data):
    with pytest.raises(ValueError, match="residual map"):
        decode_map(data, 16)
