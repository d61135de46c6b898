"""Level full: contacts are counted, and reach the Cramer-Rao bound."""

import numpy as np
import pytest

from skinbus.estimate import Estimator
from tests.oracle import cases
from tests.oracle.limit import SLACK, run


@pytest.fixture(scope="module")
def pad():
    return cases.pad()


@pytest.fixture(scope="module")
def forearm():
    return cases.arm()


def test_two_contacts_are_counted_and_reach_the_bound(pad):
    tally = run(Estimator(pad, "full"), cases.pair_inside, cases.CONE, 400, np.random.default_rng(3))
    place, force = tally.ratios(np.random.default_rng(9))
    print("seed 3", tally.counts, place, force)
    assert tally.right(2) >= 0.98
    assert place <= 1.2 * SLACK
    assert force <= 1.2 * SLACK


def test_two_contacts_across_seams_are_counted_and_reach_the_bound(forearm):
    draw = cases.pair_on_seam(forearm)
    tally = run(Estimator(forearm, "full"), draw, cases.CONE, 400, np.random.default_rng(4))
    place, force = tally.ratios(np.random.default_rng(9))
    print("seed 4", tally.counts, tally.n_excluded, place, force)
    assert tally.right(2) >= 0.95
    assert place <= 1.3 * SLACK
    assert force <= 1.3 * SLACK


def test_three_contacts_are_counted(pad):
    tally = run(Estimator(pad, "full"), cases.three_inside, cases.CONE, 300, np.random.default_rng(5))
    print("seed 5", tally.counts)
    assert tally.right(3) >= 0.95
