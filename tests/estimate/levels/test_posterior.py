"""One contact on a calibrated array is published as one, with its place and force, also amid few tactels."""

import numpy as np
import pytest

from skinbus.estimate import Estimator, learn_radial_law
from skinbus.study.surrogate import Surrogate
from skinbus.study.surrogate_table import LIMITS

CONTACTS = 250


@pytest.mark.parametrize(
    ("pitch_mm", "n_presses", "seed"),
    [
        # a faint start beside the contact, from what the law leaves on its skirts
        (6.75, 100, [90000, 1, 100, 675]),
        (6.75, 100, [11, 2, 100, 675]),
        # a place so sharp that coarse cells show next to nothing of it
        (6.75, 300, [11, 1, 300, 675]),
        # nobody has looked at
        (6.75, 100, [20261123]),
    ],
)
def test_one_contact_on_a_calibrated_array_is_one_at_its_place_with_its_force(pitch_mm, n_presses, seed):
    surrogate = Surrogate(1e-3 * pitch_mm, np.random.default_rng(seed))
    presses = surrogate.presses(n_presses)
    learned = learn_radial_law(surrogate.arm, presses.s, presses.a, None, presses.readings)
    arm = learned.apply(surrogate.arm)
    s, a = surrogate.places(CONTACTS)
    readings = surrogate.read(s, a) * learned.gain
    limits = LIMITS[pitch_mm, 300]
    for level in ("fit", "full"):
        estimator = Estimator(arm, level)
        error, nees, counts = np.empty((CONTACTS, 3)), np.empty(CONTACTS), np.empty(CONTACTS, int)
        for k, pressures in enumerate(readings):
            contacts = estimator.update(pressures, k)
            c = int(np.argmax(contacts.force))
            error[k] = contacts.s[c] - s[k], contacts.a[c] - a[k], contacts.force[c] - 1.0
            nees[k] = error[k] @ np.linalg.solve(contacts.covariance[c], error[k]) / 3.0
            counts[k] = len(contacts)
        print(level, np.hypot(*error[:, :2].T).mean(), error[:, 2].std(), nees.mean(), nees.max())
        assert (counts == 1).all()
        assert 1e3 * np.hypot(error[:, 0], error[:, 1]).mean() <= limits["mean mm"]
        assert error[:, 2].std() <= limits["cv of force"]
        assert nees.mean() <= 2.0
        assert np.mean(nees > 10.0) <= 0.003
