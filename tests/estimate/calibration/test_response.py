"""The response of an array is learned from few presses, wrong ones among them, and estimates stay true."""

import numpy as np
import pytest

from skinbus.estimate import Estimator, learn_radial_law
from tests.estimate.surrogate import PEAK, Surrogate

SEED = 20261122


@pytest.fixture(scope="module")
def learned():
    """A surrogate at 9.9 mm, 300 presses of it, two of them displaced by 5 mm, and what is learned."""
    surrogate = Surrogate(np.random.default_rng(SEED))
    presses = surrogate.presses(300, 2)
    return surrogate, presses, learn_radial_law(surrogate.arm, presses.s, presses.a, None, presses.readings)


def test_displaced_presses_are_listed_and_no_others(learned):
    _, presses, calibration = learned
    assert sorted(calibration.outliers) == sorted(presses.mislabelled)


def test_response_predicts_presses_it_was_not_learned_from(learned):
    surrogate, _, calibration = learned
    s, a = surrogate.places(300)
    truth = surrogate.truth(s, a)
    arm = calibration.apply(surrogate.arm)
    d = np.hypot(s[:, None] - arm.tactel_s, a[:, None] - arm.tactel_a)
    plain = calibration.law.profile(d)
    own = (
        calibration.law.profile(d / calibration.width) / calibration.gain
        + calibration.bias / calibration.gain
    )
    left_plain, left_own = (np.sqrt(np.mean((truth - p) ** 2)) / PEAK for p in (plain, own))
    assert left_own < 0.25 * left_plain
    assert left_own < 0.01


def test_map_is_refused_where_residuals_are_noise():
    rng = np.random.default_rng(SEED)
    surrogate = Surrogate(rng)
    presses = surrogate.presses(200, 0)
    d = np.hypot(presses.s[:, None] - surrogate.arm.tactel_s, presses.a[:, None] - surrogate.arm.tactel_a)
    readings = PEAK * np.exp(-0.5 * (d / 0.0028) ** 2) + 100.0 * rng.standard_normal(d.shape)
    assert learn_radial_law(surrogate.arm, presses.s, presses.a, None, readings).residual_map is None


@pytest.mark.parametrize("level", ["fit", "full"])
def test_contacts_between_coarse_tactels_are_true_within_what_they_claim(learned, level):
    surrogate, _, calibration = learned
    estimator = Estimator(calibration.apply(surrogate.arm), level)
    s, a = surrogate.places(300)
    readings = surrogate.read(s, a) * calibration.gain
    position, force, nees = [], [], []
    for k, row in enumerate(readings):
        contacts = estimator.update(row, k)
        assert len(contacts) == 1
        error = np.array([contacts.s[0] - s[k], contacts.a[0] - a[k], contacts.force[0] - 1.0])
        position.append(1e3 * np.hypot(*error[:2]))
        force.append(contacts.force[0])
        nees.append(error @ np.linalg.solve(contacts.covariance[0], error) / 3.0)
    assert np.mean(position) <= 0.5
    assert np.quantile(position, 0.95) <= 1.5
    assert np.mean(np.array(position) > 3.0) < 0.01
    assert np.std(force) / np.mean(force) <= 0.15
    assert 0.3 <= np.mean(nees) <= 2.0  # presses beyond the outermost tactels are never sure of their force
    assert np.mean(np.array(nees) > 5.0) <= 0.01
