"""Levels fit and full against the Cramer-Rao bound; moderate sizes of the tables in the docs."""

import numpy as np
import pytest

from skinbus.estimate import Estimator
from tests.estimate.false_contacts import count_false
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
def test_noise_makes_no_contact(level, told):
    """A fiftieth of what ``python -m tests.estimate.false_contacts`` runs."""
    print("seed 7")
    assert count_false(level, 20_000, told=told) == (0, 0)
