"""Levels fit and full against the Cramer-Rao bound; moderate sizes of the tables in the docs."""

import numpy as np
import pytest

from skinbus.estimate import Baseline, Estimator
from tests.oracle import cases
from tests.oracle.limit import SLACK, run


@pytest.fixture(scope="module")
def pad():
    return cases.pad()


@pytest.fixture(scope="module")
def forearm():
    return cases.arm()


@pytest.mark.parametrize("level", ["fit", "full"])
def test_one_contact_reaches_the_bound(level, pad):
    tally = run(Estimator(pad, level), cases.one_inside, cases.CONE, 400, np.random.default_rng(1))
    place, force = tally.ratios(np.random.default_rng(9))
    print("seed 1", tally.counts, place, force)
    assert tally.right(1) >= 0.99
    assert place <= 1.1 * SLACK
    assert force <= 1.1 * SLACK


@pytest.mark.parametrize("level", ["fit", "full"])
def test_one_contact_on_a_seam_or_corner_is_one_and_reaches_the_bound(level, forearm):
    draw = cases.on_seam(forearm)
    tally = run(Estimator(forearm, level), draw, cases.CONE, 400, np.random.default_rng(2))
    place, force = tally.ratios(np.random.default_rng(9))
    print("seed 2", tally.counts, tally.n_excluded, place, force)
    assert tally.right(1) >= 0.99
    assert place <= 1.2 * SLACK
    assert force <= 1.2 * SLACK


@pytest.mark.parametrize("level", ["fit", "full"])
def test_reported_covariance_is_neither_proud_nor_shy(level, pad):
    tally = run(Estimator(pad, level), cases.one_inside, cases.CONE, 2500, np.random.default_rng(6))
    print("seed 6", np.mean(tally.nees))
    assert np.mean(tally.nees) == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize("told", [False, True], ids=["alone", "told by a baseline"])
@pytest.mark.parametrize("level", ["kmeans", "fit", "full"])
def test_noise_makes_no_contact(level, told, forearm):
    estimator = Estimator(forearm, level)
    baseline = Baseline(forearm) if told else None
    rng = np.random.default_rng(7)
    print("seed 7")
    for n in range(5_000):
        pressures = 200.0 * rng.standard_normal(forearm.n_tactels)
        if baseline is not None:
            baseline.apply(pressures, 20_000_000 * (n + 1))
        assert len(estimator.update(pressures, 20_000_000 * (n + 1), baseline=baseline)) == 0


@pytest.mark.slow
def test_two_contacts_are_counted_and_reach_the_bound(pad):
    tally = run(Estimator(pad, "full"), cases.pair_inside, cases.CONE, 400, np.random.default_rng(3))
    place, force = tally.ratios(np.random.default_rng(9))
    print("seed 3", tally.counts, place, force)
    assert tally.right(2) >= 0.98
    assert place <= 1.2 * SLACK
    assert force <= 1.2 * SLACK


@pytest.mark.slow
def test_two_contacts_across_seams_are_counted_and_reach_the_bound(forearm):
    draw = cases.pair_on_seam(forearm)
    tally = run(Estimator(forearm, "full"), draw, cases.CONE, 400, np.random.default_rng(4))
    place, force = tally.ratios(np.random.default_rng(9))
    print("seed 4", tally.counts, tally.n_excluded, place, force)
    assert tally.right(2) >= 0.95
    assert place <= 1.3 * SLACK
    assert force <= 1.3 * SLACK


@pytest.mark.slow
def test_three_contacts_are_counted(pad):
    tally = run(Estimator(pad, "full"), cases.three_inside, cases.CONE, 300, np.random.default_rng(5))
    print("seed 5", tally.counts)
    assert tally.right(3) >= 0.95
