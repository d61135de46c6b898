"""adc: steps of the right width, inside the range, left-adjusted."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.sim.effects.adc import Adc


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


def test_error_of_quantisation_is_uniform(apply, pad):
    counts = np.random.default_rng(1).integers(0, 30000, (2000, 16)).astype(np.int32)
    print("seed 1")
    error = apply(Adc(bits=10), counts, np.zeros(2000), arm=pad, dtype=np.int32) - counts
    assert abs(error.std() / (64 / np.sqrt(12)) - 1.0) < 0.02
    assert abs(error.mean()) < 1.0


def test_range_clips_below_full_scale(apply, pad):
    counts = np.full((1, 16), 30000, np.int32)
    out = apply(Adc(bits=16, range_kpa=100.0), counts, [0.0], arm=pad, dtype=np.int32)
    assert (out == round(100e3 / pad.patches[0].patch.transducer.step)).all()


def test_object_of_eight_bits_is_never_finer_than_itself(apply):
    arm = load_arm("arm")
    counts = np.arange(arm.n_tactels, dtype=np.int32)[None] % 256 - 128
    np.testing.assert_array_equal(apply(Adc(bits=12), counts, [0.0], arm=arm, dtype=np.int32), counts)
    coarse = apply(Adc(bits=6), counts, [0.0], arm=arm, dtype=np.int32)
    assert not (coarse % 4).any()
