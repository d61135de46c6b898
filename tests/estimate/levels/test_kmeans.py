"""Level kmeans: the paper's clustering and force, K from the maxima, and one contact across seams."""

import itertools

import numpy as np
import pytest

from skinbus.estimate import Estimator
from skinbus.model import Arm, Cone, grid
from tests.oracle.fields import cone_field, elastic_field, pressures_of
from tests.skins import cone_forearm


@pytest.fixture(scope="module")
def pad():
    return Arm.single_patch(grid(4, 4, 0.010))


def test_a_press_on_a_lattice_point_is_found_exactly(pad):
    # on the centre of four tactels symmetry makes the centroid and the mean height exact
    pressures = pressures_of(pad, [(0.0, 0.0, 5.0)], cone_field)
    contacts = Estimator(pad, "kmeans").update(pressures, 7)
    assert contacts.t_ns == 7
    assert contacts.level.tolist() == ["kmeans"]
    assert [contacts.s[0], contacts.a[0]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert contacts.force[0] == pytest.approx(5.0, rel=1e-9)


def test_place_is_the_weighted_centroid_and_force_inverts_the_cone_at_the_mean_height(pad):
    pressures = pressures_of(pad, [(0.004, -0.002, 5.0)], cone_field)
    touched = pressures >= 1000.0
    weights, s, a = pressures[touched], pad.tactel_s[touched], pad.tactel_a[touched]
    contacts = Estimator(pad, "kmeans").update(pressures, 0)
    assert contacts.n_tactels.tolist() == [touched.sum()]
    centroid = np.average([s, a], axis=1, weights=weights)
    assert [contacts.s[0], contacts.a[0]] == pytest.approx(centroid, abs=1e-12)
    height = np.mean(weights + 1.2e6 * np.hypot(s - centroid[0], a - centroid[1]))  # eq. 10
    assert contacts.force[0] == pytest.approx(np.pi * height**3 / (3.0 * 1.2e6**2), rel=1e-9)  # eq. 5, 6


def spread(uv, weights, labels, k):
    """Weighted sums of squared distances from the centroids of partitions (..., n), and the centroids."""
    own = (labels[..., None] == np.arange(k)) * weights[:, None]
    centres = np.einsum("...nk,nx->...kx", own, uv) / own.sum(axis=-2)[..., None]
    return (own * ((uv[:, None] - centres[..., None, :, :]) ** 2).sum(axis=-1)).sum(axis=(-2, -1)), centres


@pytest.mark.parametrize(("n", "k"), [(4, 2), (6, 3), (8, 2), (8, 3), (9, 2), (10, 2)])
def test_clusters_are_fixed_points_and_the_best_of_random_starts_is_the_best_of_all_partitions(n, k):
    rng = np.random.default_rng(100 * n + k)
    every = np.array([labels for labels in itertools.product(range(k), repeat=n) if len(set(labels)) == k])
    for _ in range(3):
        uv, weights = rng.uniform(-0.02, 0.02, (n, 2)), rng.uniform(2e3, 2e4, n)
        arm, found = Arm.single_patch(uv), []
        for start, cycles in (("maxima", 1), ("random", 60)):
            estimator = Estimator(arm, "kmeans", start=start, k=k)
            for t_ns in range(cycles):  # the generator goes on from cycle to cycle
                contacts = estimator.update(weights, t_ns)
                if start == "random" and len(contacts) < k:
                    continue  # a cluster lost all its tactels
                own = np.stack([contacts.s, contacts.a], -1)
                labels = np.hypot(*(uv[:, None] - own).transpose(2, 0, 1)).argmin(axis=1)
                assert set(labels) == set(range(k))
                cost, centres = spread(uv, weights, labels, k)
                assert np.allclose(own, centres, atol=1e-12)
                found.append(cost)
        best = spread(uv, weights, every, k)[0].min()
        assert best * (1.0 - 1e-12) <= min(found) <= best * (1.0 + 1e-9)


def test_random_starts_are_the_same_for_the_same_seed(pad):
    pressures = pressures_of(pad, [(-0.012, 0.0, 5.0), (0.012, 0.003, 4.0)], cone_field)
    one, same, *others = (
        Estimator(pad, "kmeans", start="random", k=2, seed=seed).update(pressures, 0)
        for seed in (1, 1, 2, 3, 4)
    )
    assert np.array_equal(one.s, same.s)
    assert [len(contacts) for contacts in (one, *others)] == [2] * 4


def test_missing_and_dead_tactels_say_nothing(pad):
    pressures = pressures_of(pad, [(0.004, 0.001, 5.0)], cone_field)
    broken, loud, valid = pressures.copy(), pressures.copy(), np.ones(16, bool)
    broken[[0, 9]], loud[[0, 9]], valid[[0, 9]] = np.nan, 2e5, False
    dead = Arm.single_patch(grid(4, 4, 0.010), healthy=valid)
    answers = [
        Estimator(pad, "kmeans").update(broken, 0),
        Estimator(pad, "kmeans").update(loud, 0, valid),
        Estimator(dead, "kmeans").update(loud, 0),
    ]
    assert [len(answer) for answer in answers] == [1, 1, 1]
    assert len({(answer.s[0], answer.a[0], answer.force[0]) for answer in answers}) == 1


D = np.linspace(0.0, 0.12, 1201)
ELASTIC = elastic_field(D, 1.0)
"""A table: its quadrature is slow."""


def elastic(d, force):
    """Pressure (Pa) under an elastic layer."""
    return force * np.interp(d, D, ELASTIC, right=0.0)


@pytest.mark.parametrize(
    ("arm", "field", "n_touches", "n_cases", "right"),
    [
        (cone_forearm(), cone_field, 1, 500, 0.99),
        (cone_forearm().with_law(Cone(4e6)), elastic, 1, 500, 0.99),  # the cone that is nearest to the layer
        (cone_forearm(), cone_field, 2, 400, 0.95),
        (cone_forearm().with_law(Cone(4e6)), elastic, 2, 400, 0.95),
    ],
    ids=["cone", "elastic", "cone two", "elastic two"],
)
def test_contacts_anywhere_on_a_forearm_25_mm_apart_are_counted(arm, field, n_touches, n_cases, right):
    estimator, rng, surface = Estimator(arm, "kmeans"), np.random.default_rng(11), arm.links[0].surface
    low, high = arm.tactel_s.min() - 0.005, arm.tactel_s.max() + 0.005
    n_right = n = 0
    while n < n_cases:
        s, force = rng.uniform(low, high, n_touches), rng.uniform(2.0, 20.0, n_touches)
        a = rng.uniform(-0.5, 0.5, n_touches) * surface.period
        if n_touches == 2 and surface.distance(s[0], a[0], s[1], a[1]) < 0.025:
            continue
        fields = [pressures_of(arm, [touch], field) for touch in zip(s, a, force, strict=True)]
        if min(each.max() for each in fields) < 1000.0:
            continue
        n += 1
        contacts = estimator.update(sum(fields) + 200.0 * rng.standard_normal(arm.n_tactels), 0)
        n_right += len(contacts) == n_touches
    assert n_right >= right * n


def test_wrong_arguments_are_refused(pad):
    estimator = Estimator(pad, "kmeans")
    with pytest.raises(ValueError, match="shape"):
        estimator.update(np.zeros(15), 0)
    with pytest.raises(ValueError, match="valid"):
        estimator.update(np.zeros(16), 0, np.ones(3, bool))
    for name, value in (("level", "best"), ("start", "middle"), ("k", 0)):
        with pytest.raises(ValueError, match=name):
            Estimator(pad, **{name: value})
