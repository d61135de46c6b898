"""Level kmeans: the paper's clustering and force, K from the maxima, and one contact across seams."""

import itertools

import numpy as np
import pytest

from skinbus.estimate import Estimator
from skinbus.model import Arm, Cone, Surface, grid
from tests.oracle.arms import forearm
from tests.oracle.fields import cone_field, pressures_of

ELASTIC_SLOPE = 4e6
"""The slope whose cone is nearest to the elastic layer, Pa/m."""


@pytest.fixture(scope="module")
def pad():
    return Arm.single_patch(grid(4, 4, 0.010))


def test_no_pressure_is_no_contact(pad):
    assert len(Estimator(pad, "kmeans").update(np.zeros(16), 0)) == 0


def test_a_press_on_a_lattice_point_is_found_exactly(pad):
    # on the centre of four tactels symmetry makes the centroid and the mean height exact
    pressures = pressures_of(pad, [(0, 0.0, 0.0, 5.0)], cone_field)
    contacts = Estimator(pad, "kmeans").update(pressures, 7)
    assert contacts.t_ns == 7
    assert len(contacts) == 1
    assert contacts.s[0] == pytest.approx(0.0, abs=1e-12)
    assert contacts.a[0] == pytest.approx(0.0, abs=1e-12)
    assert contacts.force[0] == pytest.approx(5.0, rel=1e-9)
    assert contacts.level[0] == "kmeans"


def test_position_is_the_pressure_weighted_centroid_of_the_touched_tactels(pad):
    pressures = pressures_of(pad, [(0, 0.004, -0.002, 5.0)], cone_field)
    touched = pressures >= 1000.0
    weights = pressures[touched] / pressures[touched].sum()
    contacts = Estimator(pad, "kmeans").update(pressures, 0)
    assert contacts.s[0] == pytest.approx(weights @ pad.tactel_s[touched], abs=1e-12)
    assert contacts.a[0] == pytest.approx(weights @ pad.tactel_a[touched], abs=1e-12)
    assert contacts.n_tactels[0] == touched.sum()


def test_force_inverts_the_cone_at_the_mean_height(pad):
    pressures = pressures_of(pad, [(0, 0.004, -0.002, 5.0)], cone_field)
    contacts = Estimator(pad, "kmeans").update(pressures, 0)
    touched = pressures >= 1000.0
    d = np.hypot(pad.tactel_s[touched] - contacts.s[0], pad.tactel_a[touched] - contacts.a[0])
    height = np.mean(pressures[touched] + 1.2e6 * d)  # eq. 10
    assert contacts.force[0] == pytest.approx(np.pi * height**3 / (3.0 * 1.2e6**2), rel=1e-9)  # eq. 5, 6


@pytest.mark.parametrize("seed", range(20))
def test_clusters_are_a_fixed_point_of_weighted_k_means_and_no_better_than_exhaustive_search(seed):
    rng = np.random.default_rng(seed)
    print("seed", seed)
    uv = rng.uniform(-0.02, 0.02, (9, 2))
    pressures = rng.uniform(2e3, 2e4, 9)
    arm = Arm.single_patch(uv)
    contacts = Estimator(arm, "kmeans", k=2).update(pressures, 0)
    assert len(contacts) == 2
    centres = np.stack([contacts.s, contacts.a], -1)
    nearest = np.hypot(*(uv[:, None] - centres[None]).transpose(2, 0, 1)).argmin(axis=1)
    for c in range(2):
        mine = nearest == c
        assert np.allclose(np.average(uv[mine], axis=0, weights=pressures[mine]), centres[c], atol=1e-12)

    def spread(split):
        return sum(
            (pressures[m, None] * (uv[m] - np.average(uv[m], axis=0, weights=pressures[m])) ** 2).sum()
            for m in (split, ~split)
        )

    splits = (np.array(bits) for bits in itertools.product([False, True], repeat=9) if 0 < sum(bits) < 9)
    assert spread(nearest == 0) >= min(map(spread, splits)) * (1.0 - 1e-12)


def test_random_starts_are_the_same_for_the_same_seed(pad):
    pressures = pressures_of(pad, [(0, -0.012, 0.0, 5.0), (0, 0.012, 0.003, 4.0)], cone_field)
    runs = []
    for seed in (1, 1, 2, 3, 4):
        contacts = Estimator(pad, "kmeans", start="random", k=2, seed=seed).update(pressures, 0)
        runs.append(np.sort(contacts.s))
    assert np.array_equal(runs[0], runs[1])
    assert all(len(run) == 2 for run in runs)


def test_clusters_do_not_depend_on_the_order_of_tactels(pad):
    rng = np.random.default_rng(3)
    uv = rng.uniform(-0.03, 0.03, (40, 2))
    order = rng.permutation(40)
    results = []
    for positions in (uv, uv[order]):
        arm = Arm.single_patch(positions)
        pressures = pressures_of(arm, [(0, -0.02, 0.0, 5.0), (0, 0.02, 0.003, 4.0)], cone_field)
        contacts = Estimator(arm, "kmeans").update(pressures, 0)
        results.append(np.sort(np.stack([contacts.s, contacts.a, contacts.force]), axis=1))
    assert results[0].shape == (3, 2)
    assert np.allclose(results[0], results[1], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("reading", [np.nan, np.inf, -np.inf, -5e4, 1e300, 5e-324, 0.0])
def test_no_reading_makes_a_contact_that_is_not_finite(pad, reading):
    estimator = Estimator(pad, "kmeans")
    for share in (1, 5, 16):
        pressures = pressures_of(pad, [(0, 0.004, 0.001, 5.0)], cone_field)
        pressures[:share] = reading
        contacts = estimator.update(pressures, 0)
        for column in (contacts.s, contacts.a, contacts.force, contacts.covariance):
            assert np.isfinite(column).all()


def test_missing_and_dead_tactels_say_nothing(pad):
    pressures = pressures_of(pad, [(0, 0.004, 0.001, 5.0)], cone_field)
    broken = pressures.copy()
    broken[[0, 9]] = np.nan
    valid = np.ones(16, bool)
    valid[[0, 9]] = False
    healthy = valid.copy()
    loud = pressures.copy()
    loud[[0, 9]] = 2e5
    dead = Arm.single_patch(grid(4, 4, 0.010), healthy=healthy)
    answers = [
        Estimator(pad, "kmeans").update(broken, 0),
        Estimator(pad, "kmeans").update(loud, 0, valid),
        Estimator(dead, "kmeans").update(loud, 0),
    ]
    assert [len(answer) for answer in answers] == [1, 1, 1]
    assert answers[0].s[0] == answers[1].s[0] == answers[2].s[0]
    assert answers[0].force[0] == answers[1].force[0] == answers[2].force[0]


def test_a_dead_tactel_between_does_not_split_a_contact():
    arm = Arm.single_patch(np.stack([np.linspace(-0.02, 0.02, 5), np.zeros(5)], -1))
    pressures = pressures_of(arm, [(0, 0.0, 0.0, 15.0)], cone_field)
    valid = np.array([True, True, False, True, True])
    assert len(Estimator(arm, "kmeans").update(pressures, 0, valid)) == 1


@pytest.mark.parametrize(
    ("truth", "slope"), [(cone_field, 1.2e6), ("elastic", ELASTIC_SLOPE)], ids=["cone", "elastic"]
)
def test_one_contact_anywhere_on_a_forearm_is_reported_as_one(truth, slope, fields):
    right, reached, _ = count_contacts(forearm(Cone(slope)), fields(truth), 1, 500)
    print(f"{right} of {reached}")
    assert right >= 0.99 * reached


@pytest.mark.parametrize(
    ("truth", "slope"), [(cone_field, 1.2e6), ("elastic", ELASTIC_SLOPE)], ids=["cone", "elastic"]
)
def test_two_contacts_25_mm_apart_are_reported_as_two(truth, slope, fields):
    right, reached, _ = count_contacts(forearm(Cone(slope)), fields(truth), 2, 400)
    print(f"{right} of {reached}")
    assert right >= 0.95 * reached


def test_one_contact_on_a_frustum_is_reported_as_one(fields):
    length, around, pitch = 3 * 52e-3, 8, 51e-3
    radius = around * pitch / (2.0 * np.pi)
    frustum = Surface.cone(length, 1.05 * radius, radius)
    right, reached, _ = count_contacts(forearm(surface=frustum), fields(cone_field), 1, 200)
    assert right >= 0.99 * reached


@pytest.mark.parametrize(("gap", "s"), [("seam", 0.026), ("corner", 0.051)])
def test_a_contact_on_the_wrap_line_is_one(gap, s):
    arm = forearm()
    surface = arm.links[0].surface
    for a in (surface.period / 2.0, -surface.period / 2.0, surface.period / 2.0 - 0.0255):
        contacts = Estimator(arm, "kmeans").update(pressures_of(arm, [(0, s, a, 15.0)], cone_field), 0)
        assert len(contacts) == 1, gap
        assert surface.distance(s, a, contacts.s[0], contacts.a[0]) < 4e-3


def test_results_do_not_depend_on_where_the_cylinder_is_cut():
    arm = forearm()
    surface = arm.links[0].surface
    results = []
    for turn in range(8):
        a = float(surface.wrap(0.0255 + turn * surface.period / 8))
        contacts = Estimator(arm, "kmeans").update(pressures_of(arm, [(0, 0.05, a, 8.0)], cone_field), 0)
        results.append((contacts.s[0], surface.wrap(contacts.a[0] - a), contacts.force[0]))
    assert np.allclose(results, results[0], rtol=1e-9, atol=1e-12)


def test_wrong_arguments_are_refused(pad):
    estimator = Estimator(pad, "kmeans")
    with pytest.raises(ValueError, match="shape"):
        estimator.update(np.zeros(15), 0)
    with pytest.raises(ValueError, match="valid"):
        estimator.update(np.zeros(16), 0, np.ones(3, bool))
    with pytest.raises(ValueError, match="level"):
        Estimator(pad, "best")
    with pytest.raises(ValueError, match="start"):
        Estimator(pad, start="middle")
    with pytest.raises(ValueError, match="k must"):
        Estimator(pad, k=0)
    for t_ns in ("x", 1.5, None):
        with pytest.raises(TypeError, match="integer"):
            estimator.update(np.zeros(16), t_ns)


@pytest.fixture(scope="module")
def fields():
    """Give a field by name; the elastic one from a table, because its quadrature is slow."""
    from tests.oracle.fields import elastic_field

    grid_d = np.linspace(0.0, 0.12, 1201)
    table = elastic_field(grid_d, 1.0)

    def elastic(d, force):
        return force * np.interp(d, grid_d, table, right=0.0)

    return lambda truth: elastic if truth == "elastic" else truth


def count_contacts(arm, field, n_touches, n_cases, seed=11):
    """Return in how many cases the count was right, of how many that reached a tactel; and the answers."""
    rng = np.random.default_rng(seed)
    print("seed", seed)
    estimator = Estimator(arm, "kmeans")
    surface = arm.links[0].surface
    low, high = arm.tactel_s.min() - 0.005, arm.tactel_s.max() + 0.005
    right = reached = 0
    answers = []
    while reached < n_cases:
        s = rng.uniform(low, high, n_touches)
        a = rng.uniform(-0.5, 0.5, n_touches) * surface.period
        force = rng.uniform(2.0, 20.0, n_touches)
        if n_touches == 2 and surface.distance(s[0], a[0], s[1], a[1]) < 0.025:
            continue
        touches = [(0, *touch) for touch in zip(s, a, force, strict=True)]
        if any(pressures_of(arm, [touch], field).max() < 1000.0 for touch in touches):
            continue
        reached += 1
        noise = 200.0 * rng.standard_normal(arm.n_tactels)
        contacts = estimator.update(pressures_of(arm, touches, field) + noise, 0)
        answers.append((touches, contacts))
        right += len(contacts) == n_touches
    return right, reached, answers
