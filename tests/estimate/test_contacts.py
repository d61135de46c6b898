"""What an estimator promises of contacts: counted, in place, and true within their covariance or flagged."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from skinbus.config.system import load_arm
from skinbus.estimate import Estimator, Quality
from skinbus.model import Arm, Cone, Transducer, grid
from skinbus.sim.laws import Elastic
from tests.hard.ground import LAWS, NOISE, THRESHOLD, Ground, law_of, pressures_under, touch
from tests.marks import fits
from tests.skins import cone_forearm, feel_of, shipped_law

laws, loaded = pytest.mark.parametrize("law", LAWS), cache(load_arm)


class Skin:
    """A shipped arm under discs of one diameter, by the simulator's physics."""

    def __init__(self, name, diameter, seed):
        self.arm = loaded(name)
        self.rng = np.random.default_rng(seed)
        self._noise = np.random.default_rng(3)
        self._feel = feel_of(self.arm, Elastic(), 0.5 * diameter)

    def place(self, off):
        """A place (s, a) within ``off`` of the centre of some board along each axis, m."""
        placed = self.arm.patches[self.rng.integers(self.arm.n_patches)]
        return np.array((placed.s, placed.a)) + self.rng.uniform(-off, off, 2)

    def press(self, places, force, noise=1.0):
        """Readings (n_tactels,) Pa of discs at rows of (s, a), m; force N, each."""
        clean = self._feel(np.column_stack([places, np.full(len(places), force)]))
        noises = np.array(self.arm.tactel_noise) * self._noise.standard_normal(self.arm.n_tactels)
        return clean + noise * noises


def squared_error(contacts, c, s, a, force):
    """Normalised by the reported covariance, per degree of freedom."""
    error = np.array([contacts.s[c] - s, contacts.a[c] - a, contacts.force[c] - force])
    return error @ np.linalg.solve(contacts.covariance[c], error) / 3.0


# --- How many -----------------------------------------------------------------------------------------


def apart_from_each_other(rng, k, half=3.5 * 0.0065, apart=0.013):
    """k places (k, 2) m in the hull of 8 x 8 tactels."""
    while True:
        places = []
        for _ in range(400):
            place = rng.uniform(-half, half, 2)
            if all(np.hypot(*(place - other)) >= apart for other in places):
                places.append(place)
            if len(places) == k:
                return np.array(places)


@pytest.mark.slow
@laws
def test_full_counts_four_to_nine_touches_two_pitches_apart(law):
    arm = Arm.single_patch(grid(8, 8, 0.0065), law=law_of(law))
    estimator, rng = Estimator(arm, "full"), np.random.default_rng(44)
    right, off = [], []
    for k in [4, 5, 6, 7, 8, 9] * 3:
        places, forces = apart_from_each_other(rng, k), rng.uniform(2.0, 8.0, k)
        clean = pressures_under(arm, [(0, *p, f) for p, f in zip(places, forces, strict=True)])
        contacts = estimator.update(clean + NOISE * rng.standard_normal(arm.n_tactels), 0)
        right.append(len(contacts) == k)
        off.append(abs(contacts.force.sum() / forces.sum() - 1.0))
    assert np.mean(right) >= 0.94
    assert max(off) <= 0.1


@laws
@fits
def test_work_grows_with_the_number_of_contacts(law, level):
    whole = cone_forearm(rings=16)
    arm = Arm("126 boards", whole.links, whole.patches[:126]).with_law(law_of(law))
    rng = np.random.default_rng(42)
    places = np.column_stack([arm.patch_s, arm.patch_a]) + rng.uniform(-0.01, 0.01, (126, 2))
    estimator = Estimator(arm, level)
    work = {}
    for n in (20, 126):
        clean = pressures_under(arm, [(0, *place, 5.0) for place in places[:n]])
        contacts = estimator.update(clean + NOISE * rng.standard_normal(arm.n_tactels), 0)
        assert len(contacts) == n
        work[n] = estimator.n_evaluated / n
    assert work[126] <= 1.5 * work[20]


def test_cross_talk_of_rows_and_columns_makes_no_second_finger():
    skin = Arm.single_patch(grid(4, 4, 0.010), law=shipped_law())
    estimator, rng = Estimator(skin, "full"), np.random.default_rng(6)
    more = 0
    for _ in range(100):
        (s, a), force = rng.uniform(-0.018, 0.018, 2), rng.uniform(3.0, 15.0)
        read = pressures_under(skin, [(0, s, a, force)]).reshape(4, 4)
        read = 0.96 * read + 0.02 * (read.sum(0) + read.sum(1)[:, None])
        more += len(estimator.update(read.ravel() + NOISE * rng.standard_normal(16), 0)) > 1
    assert more <= 3


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
    assert two.patch[0] != two.patch[1]
    sd = np.sqrt(two.covariance[:, 2, 2])
    assert (np.abs(two.force - 8.0) < np.maximum(3.0 * sd, 1.0)).all()


@pytest.mark.slow
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


# --- True within the covariance, or flagged ------------------------------------------------------------


@laws
def test_a_touch_beyond_the_outermost_tactels_is_within_its_standard_deviations(law):
    rng = np.random.default_rng(20261124)
    arm = Ground("plane", law).board(grid(4, 4, 10e-3))
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
    assert wrong <= 0.01 * n


@pytest.mark.parametrize("size_mm", [2.0, 5.0, 12.0, 25.0])
def test_contacts_are_true_within_their_covariance_whatever_presses(size_mm):
    skin = Skin("pad", 1e-3 * size_mm, 61)
    estimator, squares = Estimator(skin.arm, "fit"), []
    for n in range(150):
        place, force = skin.place(0.013), skin.rng.uniform(2.0, 20.0)
        contacts = estimator.update(skin.press([place], force), n)
        if len(contacts) == 1 and not contacts.quality[0] & Quality.FEW_TACTELS:
            squares.append(squared_error(contacts, 0, *place, force))
    assert len(squares) >= 140
    assert np.mean(squares) <= 2.0


def test_skirts_of_a_thumb_flag_nothing():
    skin = Skin("forearm", 25e-3, 4)
    estimator, flagged = Estimator(skin.arm, "fit"), 0
    for _ in range(100):
        p = skin.press([skin.place(0.015)], skin.rng.uniform(5.0, 30.0))
        flagged += bool(estimator.update(p, 0).quality[0] & Quality.MISFIT)
    assert flagged == 0


def test_contacts_whose_peak_is_at_full_scale_are_true_within_their_covariance():
    full_scale = 100e3
    law = replace(shipped_law(), misfit=0.0)
    arm = Arm.single_patch(grid(4, 4, 0.010), law=law, transducer=Transducer(full_scale=full_scale, bits=16))
    estimator, rng, squares = Estimator(arm, "fit"), np.random.default_rng(62), []
    for k in range(600):
        s, a = rng.uniform(-0.015, 0.015, 2)
        force = np.exp(rng.uniform(np.log(15.0), np.log(60.0)))
        pressures = pressures_under(arm, [(0, s, a, force)]) + NOISE * rng.standard_normal(arm.n_tactels)
        contacts = estimator.update(np.minimum(pressures, full_scale), k)
        if len(contacts) == 1 and contacts.quality[0] & Quality.SATURATED:
            squares.append(squared_error(contacts, 0, s, a, force))
    assert len(squares) > 360
    assert np.mean(np.array(squares) > 10.0) < 0.005
    assert 0.5 < np.mean(squares) < 2.0


# --- Sizes ---------------------------------------------------------------------------------------------


@fits
def test_sizes_order_what_presses(level):
    sizes = []
    for size_mm in (2.0, 12.0, 25.0):
        skin = Skin("pad", 1e-3 * size_mm, 1)
        place = (skin.arm.tactel_s.mean() + 0.004, 0.002)
        contacts = Estimator(skin.arm, level).update(skin.press([place], 10.0, noise=0.0), 0)
        assert len(contacts) == 1
        assert not contacts.quality[0] & Quality.MISFIT
        assert contacts.force[0] == pytest.approx(10.0, rel=0.1)
        sizes.append(float(contacts.size[0]))
    assert sizes == sorted(sizes)
    assert sizes[0] < -0.2 < 0.3 < sizes[2]


def test_a_law_that_was_measured_with_what_presses_has_no_size():
    arm = Arm.single_patch(grid(4, 4, 0.010), law=Cone())
    contacts = Estimator(arm, "fit").update(pressures_under(arm, [(0, 0.002, 0.001, 5.0)]), 0)
    assert contacts.size.tolist() == [0.0]


def test_a_size_is_no_longer_published_once_the_level_falls_to_kmeans():
    skin = Skin("pad", 25e-3, 1)
    pressures = skin.press([(skin.arm.tactel_s.mean() + 0.004, 0.002)], 10.0)
    estimator = Estimator(skin.arm, "fit")
    assert estimator.update(pressures, 0).size[0] > 0.0
    assert estimator.update(pressures, 1, level="kmeans").size[0] == 0.0
