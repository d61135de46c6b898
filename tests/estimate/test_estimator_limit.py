"""Levels fit and full against the Cramer-Rao bound; moderate sizes of the tables in the docs."""

import numpy as np
import pytest

from skinbus.estimate import Baseline, Estimator
from tests.marks import fits, slow
from tests.oracle.limit import SLACK, run
from tests.skins import DRAWS, PAD, cone_forearm


@pytest.mark.parametrize(
    ("arm", "level", "draw", "n", "right", "ratio"),
    [
        (PAD, "fit", "one 2-20 N", 1, 0.99, 1.1),
        (PAD, "full", "one 2-20 N", 1, 0.99, 1.1),
        (cone_forearm(), "fit", "seam", 1, 0.99, 1.2),
        (cone_forearm(), "full", "seam", 1, 0.99, 1.2),
        *slow(
            (PAD, "full", "two", 2, 0.98, 1.2),
            (cone_forearm(), "full", "two on seam", 2, 0.95, 1.3),
            (PAD, "full", "three", 3, 0.95, np.inf),
        ),
    ],
    ids=["one-fit", "one-full", "seam-fit", "seam-full", "two-full", "two on seam-full", "three-full"],
)
def test_contacts_are_counted_and_reach_the_bound(arm, level, draw, n, right, ratio):
    found = run(Estimator(arm, level), DRAWS[draw], 400, np.random.default_rng(n))
    assert found.right >= right
    assert max(found.place, found.force) <= ratio * SLACK


@pytest.mark.slow
@fits
@pytest.mark.parametrize(
    ("arm", "draw"), [(PAD, "one 2-20 N"), (cone_forearm(), "seam")], ids=["one", "seam"]
)
def test_reported_covariance_is_neither_proud_nor_shy(arm, draw, level):
    found = run(Estimator(arm, level), DRAWS[draw], 2500, np.random.default_rng(6))
    assert found.nees == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("told", [False, *slow(True)], ids=["alone", "told by a baseline"])
def test_noise_makes_no_contact(told):
    forearm = cone_forearm()
    estimator = Estimator(forearm, "kmeans")  # other levels begin with its contacts
    baseline = Baseline(forearm) if told else None
    rng = np.random.default_rng(7)
    for n in range(2_000):
        pressures = 200.0 * rng.standard_normal(forearm.n_tactels)
        if baseline is not None:
            baseline.apply(pressures, 20_000_000 * (n + 1))
        assert len(estimator.update(pressures, 20_000_000 * (n + 1), baseline=baseline)) == 0
