"""Contacts amid few tactels, or at a rim beside others, have their place and force or are flagged."""

import numpy as np
import pytest

from skinbus.estimate import Estimator, learn_radial_law
from skinbus.study.surrogate import Surrogate
from skinbus.study.surrogate_table import LIMITS
from tests.estimate.rim_presses import CALIBRATED_WITH, Layer, calibrate, make_arm, published

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


CORNERS_MM = ((2.0, 1.0), (1.0, 2.0), (3.0, 3.0), (-2.0, 1.0), (1.0, -5.0), (-4.0, -4.0), (-7.0, 2.0))
"""Into the hull of the tactels from one of its corners; negative ones are beyond it."""
FORCES = ((5.0, 3.0), (2.0, 3.0), (5.0, 10.0), (10.0, 3.0), (15.0, 5.0))
"""N, of the finger at the corner and of another near the opposite one."""


@pytest.mark.parametrize("law", ["shipped", "calibrated"])
def test_a_finger_at_a_corner_beside_another_has_its_force_or_is_flagged(law):
    rng = np.random.default_rng(17)
    arm, gain = make_arm(), 1.0
    if law == "calibrated":
        arm, gain = calibrate(arm, 6.0, np.ones(arm.n_tactels), rng)
    layer = Layer(arm, CALIBRATED_WITH, 6.0)
    least, most = arm.tactel_s.min(), arm.tactel_s.max()
    other = np.array([most, arm.tactel_a.max() - 0.001])
    unflagged = 0
    for level in ("fit", "full"):
        estimator = Estimator(arm, level)
        for k, (place, forces) in enumerate((x, f) for x in CORNERS_MM for f in FORCES):
            places = np.array([[least, arm.tactel_a.min()] + 1e-3 * np.array(place), other])
            clean = sum(layer.feel(*at, f) for at, f in zip(places, forces, strict=True))
            contacts = estimator.update(gain * clean + arm.tactel_noise * rng.standard_normal(len(clean)), k)
            assert len(contacts) == 2
            for c in np.flatnonzero(contacts.quality == 0):
                truth = np.hypot(*(places - [contacts.s[c], contacts.a[c]]).T).argmin()
                sd = np.sqrt(published(contacts, c, law == "calibrated")[2, 2])
                assert abs(contacts.force[c] - forces[truth]) <= 3.0 * sd, (place, forces)
                assert contacts.force[c] <= 2.0 * forces[truth], (place, forces)
                unflagged += 1
    print("seed 17, contacts without a flag:", unflagged)
    assert unflagged >= 25
