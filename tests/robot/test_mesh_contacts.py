"""Contacts on the mesh of a cylinder are those on the cylinder, across seams and where the chart closes."""

import numpy as np
import pytest

from skinbus.estimate import Estimator
from tests.robot.mesh_arms import pressed, tube_arms

pytest.importorskip("potpourri3d", reason="extra skinbus[mesh]")

CYCLES = 1000
APART = 0.06
"""m, of the contacts of a cycle: how many there are of those that overlap is a close decision."""
PLACED = 5e-3
"""m: a contact whose place is less sure, beyond a tactel from where it may be, has no place to compare."""


@pytest.fixture
def arms():
    return tube_arms()


def places_apart(rng, surface, low, high):
    """One to three places, far enough from each other."""
    n = rng.integers(1, 4)
    while True:
        places = np.stack([rng.uniform(low, high, n), rng.uniform(0.0, surface.period, n)], -1)
        s, a = places.T
        if (surface.distance(s[:, None], a[:, None], s, a) + np.eye(n)).min() > APART:
            return places


@pytest.mark.slow
@pytest.mark.parametrize("level", ["kmeans", "fit", "full"])
def test_the_mesh_of_a_cylinder_has_the_contacts_of_the_cylinder(arms, level):
    flat = arms[0]
    estimators = [Estimator(arm, level, budget_us=None) for arm in arms]
    rng = np.random.default_rng(1904)
    cylinder, tube = (arm.links[0].surface for arm in arms)
    low, high = flat.tactel_s.min(), flat.tactel_s.max()
    n_contacts, off = 0, []
    for k in range(CYCLES):
        places = places_apart(rng, cylinder, low, high)
        pressures = pressed(flat, places, rng.uniform(4.0, 20.0, len(places)))
        pressures = pressures + 200.0 * rng.standard_normal(flat.n_tactels)
        one, other = (estimator.update(pressures, 20_000_000 * k) for estimator in estimators)
        assert len(one.s) == len(other.s), k
        for c, here in enumerate(cylinder.position(one.s, one.a)[0]):
            apart = np.linalg.norm(tube.position(other.s, other.a)[0] - here, axis=1)
            force = other.force[apart.argmin()] / one.force[c] - 1.0
            sd = np.sqrt(max(one.covariance[c, 0, 0] + one.covariance[c, 1, 1], 0.0))
            sd_force = np.sqrt(one.covariance[c, 2, 2]) / one.force[c]
            off.append((apart.min(), abs(force), sd, sd_force))
            n_contacts += 1
    apart, force, sd, sd_force = np.array(off).T
    assert n_contacts > 1.5 * CYCLES
    # what two tactels at a rim feel may be anywhere within centimetres, and moves with the last digit
    is_placed = sd < PLACED
    assert is_placed.mean() > 0.97
    assert (apart[is_placed] < 0.05e-3).all()
    assert (force[is_placed] < 0.01).all()
    assert (apart < np.maximum(0.05e-3, 0.5 * sd)).all()
    assert (force < np.maximum(0.01, 0.5 * sd_force)).all()
