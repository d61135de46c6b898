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


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("on", "level", "draw_of", "n", "right", "ratio"),
    [
        ("pad", "fit", lambda arm: cases.one_inside, 1, 0.99, 1.1),
        ("pad", "full", lambda arm: cases.one_inside, 1, 0.99, 1.1),
        ("forearm", "fit", cases.on_seam, 1, 0.99, 1.2),
        ("forearm", "full", cases.on_seam, 1, 0.99, 1.2),
        pytest.param("pad", "full", lambda arm: cases.pair_inside, 2, 0.98, 1.2, marks=SLOW),
        pytest.param("forearm", "full", cases.pair_on_seam, 2, 0.95, 1.3, marks=SLOW),
        pytest.param("pad", "full", lambda arm: cases.three_inside, 3, 0.95, np.inf, marks=SLOW),
    ],
    ids=["one-fit", "one-full", "seam-fit", "seam-full", "two-full", "two on seam-full", "three-full"],
)
def test_contacts_are_counted_and_reach_the_bound(on, level, draw_of, n, right, ratio, request):
    arm = request.getfixturevalue(on)
    tally = run(Estimator(arm, level), draw_of(arm), cases.CONE, 400, np.random.default_rng(n))
    place, force = tally.ratios(np.random.default_rng(9))
    print(f"seed {n}", tally.counts, tally.n_excluded, place, force)
    assert tally.right(n) >= right
    assert max(place, force) <= ratio * SLACK


@pytest.mark.parametrize("level", ["fit", pytest.param("full", marks=SLOW)])
def test_reported_covariance_is_neither_proud_nor_shy(level, pad):
    tally = run(Estimator(pad, level), cases.one_inside, cases.CONE, 2500, np.random.default_rng(6))
    print("seed 6", np.mean(tally.nees))
    assert np.mean(tally.nees) == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize("told", [False, pytest.param(True, marks=SLOW)], ids=["alone", "told by a baseline"])
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
