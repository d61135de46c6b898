"""Readings at full scale are bounds: moments of a cut normal, and contacts whose peak is not read."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

from skinbus.estimate import Estimator, Quality
from skinbus.estimate.kernels.censored import cut_normal
from skinbus.jit import kernel
from skinbus.model import Arm, Transducer
from skinbus.model.patch import grid
from skinbus.study.skin_models import NOISE, shipped_law

FULL_SCALE = 100e3


@kernel
def moments(z: float) -> tuple[float, float]:
    """Return what the inner kernel does."""
    return cut_normal(z)


@pytest.mark.parametrize("z", [-33.0, -9.0, -7.0, -2.0, 0.0, 1.5, 6.0, 40.0])
def test_moments_are_those_of_a_cut_normal(z):
    ratio, shrink = moments(z)
    expected = np.exp(norm.logpdf(z) - norm.logcdf(z))
    assert ratio == pytest.approx(expected, rel=1e-4, abs=1e-12)
    assert 1.0 - shrink == pytest.approx(truncnorm(-z, np.inf).var(), rel=0.05)
    assert 0.0 <= shrink <= 1.0


def test_contacts_whose_peak_is_at_full_scale_are_true_within_their_covariance():
    law = replace(shipped_law(), misfit=0.0)
    transducer = Transducer(full_scale=FULL_SCALE, bits=16)
    arm = Arm.single_patch(grid(4, 4, 0.010), law=law, transducer=transducer)
    estimator, rng, squares = Estimator(arm, "fit"), np.random.default_rng(62), []
    for k in range(1500):
        s, a = rng.uniform(-0.015, 0.015, 2)
        force = np.exp(rng.uniform(np.log(15.0), np.log(60.0)))
        d = arm.links[0].surface.distance(arm.tactel_s, arm.tactel_a, s, a)
        pressures = law.pressure(d, force) + NOISE * rng.standard_normal(arm.n_tactels)
        contacts = estimator.update(np.minimum(pressures, FULL_SCALE), k)
        if len(contacts) == 1 and contacts.quality[0] & Quality.SATURATED:
            error = np.array([contacts.s[0] - s, contacts.a[0] - a, contacts.force[0] - force])
            squares.append(error @ np.linalg.solve(contacts.covariance[0], error) / 3.0)
    print("seed 62:", len(squares), np.mean(squares), np.mean(np.array(squares) > 10.0))
    assert len(squares) > 900
    assert np.mean(np.array(squares) > 10.0) < 0.003
    assert 0.5 < np.mean(squares) < 2.0
