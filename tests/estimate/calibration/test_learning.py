"""Calibration: what is put into presses comes out of them."""

import numpy as np
import pytest

from skinbus.estimate.calibration.learning import TRIM, learn_radial_law
from skinbus.model import Arm, Cone, Link, PlacedPatch, Surface, Transducer, grid
from tests.skins import shipped_law

SEED = 20261121
N_PRESSES = 200
NOISE = 100.0
H = 6e-3


def profile(d):
    """A cover of 6 mm, as a half-space has it at that depth, with the dip of a real one: -2 % of the peak."""
    return 3.0 * H**3 / (2.0 * np.pi * (d * d + H * H) ** 2.5) - 260.0 * np.exp(-(((d - 0.016) / 0.004) ** 2))


def pad(**settings):
    settings.setdefault("transducer", Transducer(full_scale=1e6))
    return Arm.single_patch(grid(4, 4, 0.010), **settings)


def presses(arm, rng, *, exponent=1.0, noise=NOISE, force=None):
    """Random presses on the pad: s, a, force, pressures, and the gains put in (mean response 1)."""
    s, a = rng.uniform(-0.02, 0.02, (2, N_PRESSES))
    force = rng.uniform(2.0, 20.0, N_PRESSES) if force is None else np.full(N_PRESSES, force)
    gain = 1.0 / (1.0 + 0.03 * rng.standard_normal(arm.n_tactels))
    gain *= np.mean(1.0 / gain)
    d = arm.distance(slice(None), s, a)
    pressures = force[:, None] ** exponent * profile(d) / gain
    return s, a, force, pressures + noise * rng.standard_normal(pressures.shape), gain


@pytest.mark.parametrize(("exponent", "force"), [(1.0, None), (0.8, None), (1.2, None), (1.0, 7.0)])
def test_profile_gains_noise_and_exponent_are_recovered_and_of_an_unknown_force_up_to_scale(exponent, force):
    arm = pad()
    made = presses(arm, np.random.default_rng(SEED), exponent=exponent, force=force)
    s, a, stated, pressures, gain = made
    learned = learn_radial_law(arm, s, a, None if force else stated, pressures)
    d, scale = np.linspace(0.0, 0.015, 100), force or 1.0
    assert learned.converged
    assert learned.law.exponent == pytest.approx(exponent, abs=2e-3)
    # 200 presses, the weakest with 1 % of noise: a part in 200 of the peak
    np.testing.assert_allclose(learned.law.profile(d), scale * profile(d), atol=scale * profile(0.0) / 200)
    np.testing.assert_allclose(learned.gain, gain, rtol=5e-3)
    np.testing.assert_allclose(learned.noise, NOISE, rtol=0.25)
    assert learned.residual == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("noise", [0.0, 100.0, 600.0])
def test_rounding_to_eight_bits_is_noise_and_makes_no_outliers(noise):
    """A step of such a board is 2 kPa: what is quiet reads 0, always, and is uncertain all the same."""
    transducer = Transducer(full_scale=250e3, bits=8)
    arm = pad(transducer=transducer)
    s, a, force, pressures, gain = presses(arm, np.random.default_rng(SEED), noise=noise)
    learned = learn_radial_law(arm, s, a, force, transducer.pressure(transducer.counts(pressures)))
    assert learned.converged
    assert (learned.noise >= transducer.step / np.sqrt(12.0) * 0.9).all()
    assert not len(learned.outliers)
    assert 0.3 < learned.residual < 1.2
    np.testing.assert_allclose(learned.gain, gain, rtol=0.03)


def test_missing_saturated_and_dead_readings_change_nothing_else():
    rng = np.random.default_rng(SEED)
    arm = pad(transducer=Transducer(full_scale=60e3), healthy=np.arange(16) != 5)
    s, a, force, pressures, gain = presses(arm, rng)
    pressures = np.minimum(pressures, 60e3)
    pressures[:, 5] = 1e5 * rng.standard_normal(N_PRESSES)
    pressures[rng.random(pressures.shape) < 0.2] = np.nan
    learned = learn_radial_law(arm, s, a, force, pressures)
    # leaving out what is at full scale leaves out the larger of the readings near it: 2 %
    assert learned.law.profile(0.0) == pytest.approx(profile(0.0), rel=0.02)
    np.testing.assert_allclose(np.delete(learned.gain, 5), np.delete(gain, 5), rtol=1e-2)


@pytest.mark.parametrize("forces", [(5.0, 5.0), (2.0, 20.0)], ids=["one force", "many forces"])
def test_learning_comes_to_rest_where_no_radial_law_is_true_and_says_how_wrong_it_is(forces):
    arm, law = pad(), Cone(2e6)
    rng = np.random.default_rng(SEED)
    s, a = rng.uniform(-0.02, 0.02, (2, N_PRESSES))
    force = rng.uniform(*forces, N_PRESSES)
    d = arm.distance(slice(None), s, a)
    learned = learn_radial_law(arm, s, a, force, law.pressure(d, force[:, None]))
    assert learned.converged
    # the reach of a cone grows with its force, and a radial law has one reach for all
    assert learned.law.misfit < 1e-3 if forces[0] == forces[1] else learned.law.misfit > 0.1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"force": [0.0, 1.0]}, "positive"),
        ({"a": [0.0]}, "shapes"),
        ({"pressures": np.zeros((2, 15))}, "shapes"),
        ({"pressures": np.full((2, 16), np.nan)}, "usable"),
        ({"pressures": np.zeros((2, 16))}, "places"),
        ({"pressures": -np.ones((2, 16))}, "places"),
    ],
)
def test_what_cannot_be_learned_from_is_refused(change, words):
    good = {"s": [0.0, 0.01], "a": [0.0, 0.01], "force": [5.0, 5.0], "pressures": np.ones((2, 16))}
    with pytest.raises(ValueError, match=words):
        learn_radial_law(pad(), **(good | change))


@pytest.mark.slow
@pytest.mark.parametrize("place_sd", [0.05e-3, 0.3e-3, 0.6e-3])
def test_errors_of_place_are_not_learned_as_gains_widths_or_the_end_of_the_law(place_sd):
    """Six boards, 40 presses each, of which all are said to err by 0.3 mm; forces err by 1 %."""
    rng, law, force = np.random.default_rng([SEED, 31]), shipped_law(), 5.0
    patch, which = pad().patches[0].patch, np.repeat(np.arange(6), 40)
    boards = [PlacedPatch(patch=patch, node_id=1 + k, link=0, s=0.05 + 0.08 * k, a=0.0) for k in range(6)]
    arm = Arm("six", [Link("link", Surface.plane(0.55, 0.2))], boards)
    s, a = rng.uniform(-0.02, 0.02, (2, len(which)))
    s += 0.05 + 0.08 * which
    gain = 1.0 + 0.05 * rng.standard_normal(arm.n_tactels)
    d = arm.distance(slice(None), s, a)
    pressed = force * np.exp(0.01 * rng.standard_normal((len(s), 1)))
    pressures = gain * law.pressure(d, pressed) + NOISE * rng.standard_normal(d.shape)
    pressures[which[:, None] != arm.tactel_patch] = np.nan
    said = np.array([s, a]) + place_sd * rng.standard_normal((2, len(s)))
    learned = learn_radial_law(arm, *said, np.full(len(s), force), pressures, place_sd=0.3e-3, maps=False)
    foot = np.linspace(0.020, 0.028, 50)
    off = np.abs(learned.law.profile(foot) - law.profile(foot)).max() / law.table[0]
    left = float(np.std(learned.gain * gain))
    assert left < 0.025  # 5 % before; 3 to 4 % where each reading is taken to err on its own
    assert np.std(learned.width) < 0.012
    assert off < 2.0 * TRIM
    assert len(learned.outliers) <= 0.02 * len(s)
