"""No reading, however extreme, makes the estimator raise, hang, or answer with what is not a number.

A cycle mixes, tactel by tactel, readings from a pool: zeros, the smallest and largest numbers, not a number,
full scale and one count beside it, thresholds, noise, and the fields of true touches.
"""

import numpy as np
import pytest

from skinbus.estimate import LEVELS, Estimator
from tests.hard.check import WORK_PER_TACTEL, check_contacts
from tests.hard.ground import FULL_SCALE, LAWS, NOISE, SURFACES, THRESHOLD, Ground, pressures_under
from tests.marks import slow

COUNT = FULL_SCALE / 32767.0
POOL = np.array(
    [
        *(0.0, -0.0, 5e-324, -5e-324, 1e-300, -1e-300, 1e300, -1e300, np.nan, np.inf, -np.inf),
        *(FULL_SCALE, FULL_SCALE - COUNT, FULL_SCALE + COUNT, -FULL_SCALE, -FULL_SCALE - COUNT),
        *(THRESHOLD, np.nextafter(THRESHOLD, 0.0), 0.7 * THRESHOLD, 3.0 * NOISE, COUNT, -COUNT),
        *(1e3, 5e3, 2e4, 1e5),
    ]
)


def random_readings(arm, rng):
    """One cycle of readings."""
    n = arm.n_tactels
    kind = rng.integers(4)
    if kind == 0:  # a pattern of few values
        return rng.choice(rng.choice(POOL, size=rng.integers(1, 4)), size=n)
    fields = NOISE * rng.standard_normal(n) * (10.0 ** rng.uniform(-3, 2) if kind == 3 else 1.0)
    for _ in range(rng.integers(0, 6)):
        p = arm.patches[rng.integers(arm.n_patches)]
        u, v = rng.uniform(-0.03, 0.03, 2)
        fields += pressures_under(arm, [(0, p.s + u, p.a + v, 10.0 ** rng.uniform(-3.0, 4.0))])
    broken = rng.random(n) < rng.choice([0.0, 0.05, 0.5])
    return np.where(broken, rng.choice(POOL, size=n), fields)


@pytest.mark.parametrize("n_cycles", [36, *slow(720)])
def test_extreme_readings_give_sound_contacts_in_bounded_work(n_cycles):
    # one board and two across a seam
    boards = [
        ground.mount([ground.arm().patches[0].patch] * n)
        for ground in (Ground(surface, law) for surface in SURFACES for law in LAWS)
        for n in (1, 2)
    ]
    estimators, rng, n_contacts = [Estimator(arm, "full") for arm in boards], np.random.default_rng(1), 0
    for cycle in range(n_cycles):
        arm, estimator = boards[cycle % len(boards)], estimators[cycle % len(boards)]
        level = LEVELS[cycle // len(boards) % len(LEVELS)]
        readings = random_readings(arm, rng)
        contacts = estimator.update(readings, cycle, rng.random(arm.n_tactels) < 0.97, level=level)
        where = f"seed 1, cycle {cycle}, {arm.name}, {level}"
        assert check_contacts(arm, contacts, level) == [], where
        assert estimator.n_evaluated <= WORK_PER_TACTEL * arm.n_tactels, where
        n_contacts += len(contacts)
    assert n_contacts > n_cycles // 2
