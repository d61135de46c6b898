"""A touch that no contact explains is found, or flags the contact beside it."""

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.estimate import Estimator, Quality
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.laws import Elastic
from skinbus.sim.layer import Geometry, Loads


class Skin:
    """An arm under discs of one diameter, on the simulator's physics."""

    def __init__(self, name, diameter, seed):
        print("seed", seed)
        self.arm = load_arm(name)
        self.rng = np.random.default_rng(seed)  # of places and forces
        self._noise = np.random.default_rng(3)
        self.radius = 0.5 * diameter
        self._law = Elastic().bind(Geometry.of(self.arm, discs=True), [Indenter(Shape.DISC, diameter)])

    def place(self, off):
        """Return a place (s, a) within ``off`` of the centre of some board along each axis, m."""
        placed = self.arm.patches[self.rng.integers(self.arm.n_patches)]
        return np.array((placed.s, placed.a)) + self.rng.uniform(-off, off, 2)

    def press(self, places, force, gain=1.0):
        """Return readings (n_tactels,) Pa, with noise, of discs at rows of (s, a), m; force N, each."""
        loads, clean = Loads(len(places)), np.zeros(self.arm.n_tactels)
        loads.n = len(places)
        loads.s[:], loads.a[:] = np.transpose(places)
        loads.force[:], loads.radius[:] = force, self.radius
        self._law.add(loads, clean, np.zeros(self.arm.n_patches, np.bool_))
        return gain * clean + np.array(self.arm.tactel_noise) * self._noise.standard_normal(
            self.arm.n_tactels
        )


@pytest.mark.parametrize(
    "places",
    [
        ((0.0884, -0.0624), (0.1138, -0.0803)),  # 31 mm apart, across a corner of four boards
        ((0.0475, -0.1652), (0.0646, -0.1945)),  # 34 mm
        ((0.0817, 0.0094), (0.1039, 0.0023)),  # 23 mm; the second reads 7 kPa, beside 33
    ],
)
def test_two_fingers_across_a_seam_are_not_one_of_the_force_of_one_without_a_flag(places):
    skin = Skin("forearm", 12e-3, 3)
    p = skin.press(places, 8.0)
    one = Estimator(skin.arm, "fit").update(p, 0)
    assert len(one) == 2 or one.quality[0] & Quality.MISFIT
    two = Estimator(skin.arm, "full").update(p, 0)
    assert not (two.quality & Quality.MISFIT).any()
    sd = np.sqrt(two.covariance[:, 2, 2])
    assert (np.abs(two.force - 8.0) < np.maximum(3.0 * sd, 1.0)).all()


def test_two_fingers_two_pitches_apart_are_two_at_fit_and_none_runs_away():
    skin = Skin("forearm", 12e-3, 5)
    estimator, found = Estimator(skin.arm, "fit"), []
    for n in range(60):
        first = skin.place(0.02)
        way, apart = skin.rng.uniform(0.0, 2.0 * np.pi), skin.rng.uniform(0.018, 0.024)
        p = skin.press((first, first + apart * np.array((np.cos(way), np.sin(way)))), 8.0)
        contacts = estimator.update(p, n)
        found.append(len(contacts))
        unsure = 3.0 * np.sqrt(contacts.covariance[:, 2, 2]) + 16.0
        assert ((contacts.force < unsure) | (contacts.quality != 0)).all()
    assert found.count(2) >= 48
    assert max(found) == 2


def test_skirts_of_a_thumb_flag_nothing():
    skin = Skin("forearm", 25e-3, 4)
    estimator, flagged = Estimator(skin.arm, "fit"), 0
    for _ in range(100):
        p = skin.press([skin.place(0.015)], skin.rng.uniform(5.0, 30.0))
        flagged += bool(estimator.update(p, 0).quality[0] & Quality.MISFIT)
    assert flagged == 0


def test_a_finger_on_a_row_of_half_its_gain_is_hardly_ever_two():
    skin = Skin("pad", 12e-3, 6)
    estimator, n_two = Estimator(skin.arm, "fit"), 0
    gain = np.where(np.arange(skin.arm.n_tactels) // 4 == 1, 0.5, 1.0)
    for n in range(600):
        contacts = estimator.update(skin.press([skin.place(0.018)], skin.rng.uniform(3.0, 15.0), gain), n)
        n_two += len(contacts) > 1 and not contacts.quality.all()
    assert n_two <= 4  # 2 now; 9 with a second contact however weak
