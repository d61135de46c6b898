"""Many contacts at once: each is found, and the work grows with their number, not with its square."""

import numpy as np
import pytest

from skinbus.estimate import Estimator
from skinbus.model import Arm, Cone
from skinbus.model.patch import grid
from skinbus.study.skin_models import cone_forearm, shipped_law

SIGMA = 200.0
APART = 0.013
HALF = 3.5 * 0.0065
"""m, of the hull of 8 x 8 tactels 6.5 mm apart."""
LAWS = {"cone": Cone(), "radial": shipped_law()}


def draw(rng, k):
    """k places (k, 2) m, each ``APART`` from all others, and forces (k,) N."""
    while True:
        places = []
        for _ in range(400):
            place = rng.uniform(-HALF, HALF, 2)
            if all(np.hypot(*(place - other)) >= APART for other in places):
                places.append(place)
            if len(places) == k:
                return np.array(places), rng.uniform(2.0, 8.0, k)


def pressures_of(arm, law, places, forces, rng):
    """(n_tactels,) Pa on link 0."""
    d = arm.links[0].surface.distance(arm.tactel_s, arm.tactel_a, places[:, :1], places[:, 1:])
    clean = sum(law.pressure(d[i], forces[i]) for i in range(len(places)))
    return clean + SIGMA * rng.standard_normal(arm.n_tactels)


def chi2_of(arm, law, contacts, pressures):
    d = (
        arm.links[0].surface.distance(arm.tactel_s, arm.tactel_a, contacts.s[:, None], contacts.a[:, None])
        / contacts.width[:, None]
    )
    pressed = [law.pressure(d[i], contacts.force[i]) / contacts.width[i] ** 2 for i in range(len(contacts))]
    return float((((pressures - sum(pressed)) / SIGMA) ** 2).sum())


@pytest.fixture(scope="module", params=sorted(LAWS))
def scenes(request):
    """Law, and for scenes of 4 to 9 touches (seed 44): truth, pressures, contacts of fit and of full."""
    law = LAWS[request.param]
    arm = Arm.single_patch(grid(8, 8, 0.0065)).with_law(law)
    estimator = Estimator(arm, "full")
    rng = np.random.default_rng(44)
    found = []
    for k in range(4, 10):
        for _ in range(4):
            places, forces = draw(rng, k)
            p = pressures_of(arm, law, places, forces, rng)
            found.append((forces, p, estimator.update(p, 0, level="fit"), estimator.update(p, 0)))
    return arm, law, found


def test_full_counts_four_to_nine_touches_a_pitch_and_more_apart(scenes):
    _, _, found = scenes
    right = sum(len(full) == len(forces) for forces, _, _, full in found)
    assert right >= 0.95 * len(found)
    off = [abs(full.force.sum() / forces.sum() - 1.0) for forces, _, _, full in found]
    assert max(off) <= 0.1


def test_full_leaves_no_fewer_contacts_than_fit_while_some_are_missing(scenes):
    arm, law, found = scenes
    for _, p, fit, full in found:
        if chi2_of(arm, law, full, p) > 2.0 * arm.n_tactels:
            assert len(full) >= len(fit)


def test_full_never_has_a_worse_penalised_likelihood_than_fit(scenes):
    arm, law, found = scenes
    for _, p, fit, full in found:
        fit_chi2, full_chi2 = chi2_of(arm, law, fit, p), chi2_of(arm, law, full, p)
        scale = max(1.0, full_chi2 / max(arm.n_tactels - 3 * len(full), 1))
        # sizes are settled to 0.01 of a chi^2 in which a reading of 20 kPa counts a hundred times less
        assert full_chi2 / scale + 25.0 * len(full) <= fit_chi2 / scale + 25.0 * len(fit) + 2.0


@pytest.mark.parametrize("law", sorted(LAWS))
@pytest.mark.parametrize("level", ["fit", "full"])
def test_work_grows_with_the_number_of_contacts(law, level):
    whole = cone_forearm(rings=16)
    arm = Arm("126 boards", whole.links, whole.patches[:126]).with_law(LAWS[law])
    rng = np.random.default_rng(42)
    places = np.column_stack([arm.patch_s, arm.patch_a]) + rng.uniform(-0.01, 0.01, (126, 2))
    estimator = Estimator(arm, level)
    work = {}
    for n in (20, 126):
        p = pressures_of(arm, LAWS[law], places[:n], np.full(n, 5.0), rng)
        assert len(estimator.update(p, 0)) == n
        work[n] = estimator.n_evaluated / n
    assert work[126] <= 1.5 * work[20]
    assert work[126] <= (400 if level == "fit" else 12_000)
