"""Coverage agrees with simulated presses where the bound holds, and with what the estimator registers."""

import numpy as np
import pytest

from skinbus.estimate import Estimator
from skinbus.model import Arm, Cone, Link, Patch, PlacedPatch, Radial, Surface, grid
from skinbus.planning.coverage import FORCE, cover

SEED = 7773  # not that with which the limits of this file were found


def ring(law=None, *, gap=1e-3, n=3, noise=200.0):
    """Boards around a third of a cylinder, and bare skin elsewhere."""
    patch = Patch(tactels_uv=grid(4, 4, 0.010), noise=noise, **({"law": law} if law else {}))
    surface = Surface.cylinder(0.06, 0.06)
    placed = [
        PlacedPatch(patch=patch, node_id=k + 1, link=0, s=0.03, a=(k - 0.5 * (n - 1)) * (0.05 + gap))
        for k in range(n)
    ]
    return Arm("ring", [Link("forearm", surface)], placed)


def radial():
    d = np.arange(40) * 0.5e-3
    return Radial(step=0.5e-3, table=5e3 * np.exp(-0.5 * (d / 4e-3) ** 2))


def pressures(arm, s, a, force):
    return arm.patches[0].patch.law.pressure(arm.distance(slice(None), s, a), force)


@pytest.mark.slow
@pytest.mark.parametrize("law", [Cone(), radial()], ids=["cone", "radial"])
def test_contacts_scatter_as_predicted_within_a_tenth_or_say_that_they_do_not(law):
    """2000 presses anywhere on boards and seams, by the arm's law and noise, estimated at level full."""
    arm = ring(law)
    (coverage,) = cover(arm, step=1e-3)
    rng = np.random.default_rng(SEED)
    usable = np.argwhere(coverage.holds)
    assert len(usable) > 1500  # of 7500 on boards: the rims are outside of all tactels
    estimator, rows = Estimator(arm, level="full"), []
    for i in map(tuple, rng.choice(usable, 2000)):
        truth = coverage.s[i], coverage.a[i]
        noisy = pressures(arm, *truth, FORCE) + 200.0 * rng.standard_normal(arm.n_tactels)
        contacts = estimator.update(noisy, 0)
        assert len(contacts) == 1
        if contacts.covariance[0, 2, 2] < (2.0 * coverage.sd_force[i]) ** 2:
            off = arm.links[0].surface.distance(contacts.s[0], contacts.a[0], *truth)
            rows.append((off, contacts.force[0] - FORCE, coverage.sd_place[i], coverage.sd_force[i]))
    assert len(rows) > 1960
    table = np.array(rows)
    for errors, predicted in (table[:, ::2].T, table[:, 1::2].T):
        # by quarters from best to worst predicted, so that good points do not hide bad ones
        for part in np.array_split(np.argsort(predicted), 4):
            ratio = np.sqrt((errors[part] ** 2).mean() / (predicted[part] ** 2).mean())
            assert ratio == pytest.approx(1.0, abs=0.1)


def test_what_is_registered_begins_at_the_least_force():
    arm = ring()
    (coverage,) = cover(arm, step=2e-3)
    rng = np.random.default_rng(SEED)
    estimator = Estimator(arm, level="kmeans")
    for i in map(tuple, rng.choice(np.argwhere(np.isfinite(coverage.least_force)), 200)):
        where = coverage.s[i], coverage.a[i]
        for factor, n in ((0.99, 0), (1.01, 1)):
            readings = pressures(arm, *where, factor * coverage.least_force[i])
            assert len(estimator.update(readings, 0)) == n


def test_areas_are_those_of_the_surface_and_bare_skin_is_blind():
    arm = ring(gap=0.0)
    links = [*arm.links, Link("bare", Surface.plane(0.06, 0.04))]
    coverage, bare = cover(Arm("two links", links, arm.patches))
    surface = arm.links[0].surface
    assert coverage.area.sum() == pytest.approx(surface.length * surface.width)
    assert coverage.area[coverage.board >= 0].sum() == pytest.approx(3 * 0.05**2, rel=0.03)
    blind = np.isinf(coverage.least_force)
    assert 0.0 < coverage.area[blind].sum() < coverage.area[coverage.board < 0].sum()
    assert np.isinf(bare.least_force).all()
