"""Contacts at a rim, under a law held for true: of the places that explain the readings the likelier."""

import numpy as np
import pytest

from skinbus.estimate import Estimator
from skinbus.model import grid
from tests.hard.ground import LAWS, NOISE, THRESHOLD, Ground, pressures_under, touch


@pytest.mark.parametrize("kind", LAWS)
def test_a_touch_beyond_the_outermost_tactels_is_within_its_standard_deviations_at_level_fit(kind):
    rng = np.random.default_rng(20261124)
    arm = Ground("plane", kind).board(grid(4, 4, 10e-3))
    estimator = Estimator(arm, "fit")
    n = wrong = 0
    while n < 400:
        u, v, force = *rng.uniform(-24e-3, 24e-3, 2), 2.0 * 10.0 ** rng.random()
        truth = touch(arm, 0, u, v, force)
        clean = pressures_under(arm, [truth])
        if max(abs(u), abs(v)) < 15e-3 or (clean > THRESHOLD).sum() < 3:
            continue
        contacts = estimator.update(clean + NOISE * rng.standard_normal(arm.n_tactels), n)
        n += 1
        for c in np.flatnonzero(contacts.quality == 0):
            off = np.array([contacts.s[c] - truth[1], contacts.a[c] - truth[2]])
            place, sd = contacts.covariance[c, :2, :2], np.sqrt(contacts.covariance[c, 2, 2])
            wrong += off @ np.linalg.solve(place, off) > 36.0 or abs(contacts.force[c] - force) > 6.0 * sd
    print("seed 20261124,", kind, wrong, "of", n, "beyond six standard deviations without a flag")
    # the law is exact, so all of these are another mode; where it was not asked for they were 3 to 6 in 100
    assert wrong <= 0.01 * n


def test_level_fit_finds_the_same_places_where_level_full_is_available():
    rng = np.random.default_rng(20261125)
    arm = Ground("plane", "cone").board(grid(4, 4, 10e-3))
    fit, full = Estimator(arm, "fit"), Estimator(arm, "full")
    for n in range(40):
        clean = pressures_under(arm, [touch(arm, 0, *rng.uniform(-24e-3, 24e-3, 2), 5.0)])
        pressures = clean + NOISE * rng.standard_normal(arm.n_tactels)
        places = [e.update(pressures, n, level="fit") for e in (fit, full)]
        assert np.array_equal(places[0].s, places[1].s), f"cycle {n}"
        assert np.array_equal(places[0].covariance, places[1].covariance), f"cycle {n}"
