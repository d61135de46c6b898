"""viscoelastic: relaxation and creep of a standard linear solid, with its time constants."""

import numpy as np
import pytest

from skinbus.sim.effects.viscoelastic import Viscoelastic

T = np.arange(0.0, 6.0, 1e-3)


def test_pressure_relaxes_under_held_position(apply, pad):
    effect = Viscoelastic(relaxation=0.3, tau_s=0.8, control="position")
    out = apply(effect, 1000.0, T, arm=pad)[:, 0]
    np.testing.assert_allclose(out, 1000.0 * (1.0 - 0.3 * (1.0 - np.exp(-T / 0.8))), rtol=1e-9)


def test_reading_creeps_under_held_force(apply, pad):
    out = apply(Viscoelastic(relaxation=0.2, tau_s=0.8), 1000.0, T, arm=pad)[:, 0]
    tau = 0.8 / 0.8
    np.testing.assert_allclose(out, 1000.0 * (1.0 + 0.25 * (1.0 - np.exp(-T / tau))), rtol=1e-9)


def test_creep_recovers_when_the_load_is_gone(apply, pad):
    load = np.where(T < 3.0, 1000.0, 0.0)[:, None]
    out = apply(Viscoelastic(relaxation=0.2, tau_s=0.8), load, T, arm=pad)[:, 0]
    after = T >= 3.0
    left = 250.0 * (1.0 - np.exp(-3.0)) * np.exp(-(T[after] - 3.0))
    np.testing.assert_allclose(out[after], left, rtol=5e-3)


@pytest.mark.parametrize("control", ["force", "position"])
def test_answer_does_not_depend_on_the_rate_of_sampling(apply, pad, control):
    effect = Viscoelastic(relaxation=0.3, tau_s=0.8, control=control)
    coarse = apply(effect, 1000.0, T[::200], arm=pad)
    np.testing.assert_allclose(coarse, apply(effect, 1000.0, T, arm=pad)[::200], rtol=1e-9)


def test_it_is_linear(apply, forearm):
    rng = np.random.default_rng(3)
    print("seed 3")
    a, b = 1e4 * rng.random((2, 50, forearm.n_tactels))
    t = 0.02 * np.arange(50)
    both = apply(Viscoelastic(), a + 2 * b, t)
    np.testing.assert_allclose(both, apply(Viscoelastic(), a, t) + 2 * apply(Viscoelastic(), b, t), rtol=1e-9)
