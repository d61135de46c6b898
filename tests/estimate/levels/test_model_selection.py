"""Level full: contacts are counted, and reach the Cramer-Rao bound."""

from dataclasses import replace

import numpy as np
import pytest

from skinbus.estimate import Estimator
from skinbus.model import Arm
from skinbus.study.skin_models import layout, shipped_law
from tests.hard.ground import pressures_under
from tests.oracle import cases
from tests.oracle.limit import SLACK, run


@pytest.fixture(scope="module")
def pad():
    return cases.pad()


@pytest.fixture(scope="module")
def forearm():
    return cases.arm()


def test_two_contacts_are_counted_and_reach_the_bound(pad):
    tally = run(Estimator(pad, "full"), cases.pair_inside, cases.CONE, 400, np.random.default_rng(3))
    place, force = tally.ratios(np.random.default_rng(9))
    print("seed 3", tally.counts, place, force)
    assert tally.right(2) >= 0.98
    assert place <= 1.2 * SLACK
    assert force <= 1.2 * SLACK


def test_two_contacts_across_seams_are_counted_and_reach_the_bound(forearm):
    draw = cases.pair_on_seam(forearm)
    tally = run(Estimator(forearm, "full"), draw, cases.CONE, 400, np.random.default_rng(4))
    place, force = tally.ratios(np.random.default_rng(9))
    print("seed 4", tally.counts, tally.n_excluded, place, force)
    assert tally.right(2) >= 0.95
    assert place <= 1.3 * SLACK
    assert force <= 1.3 * SLACK


def test_three_contacts_are_counted(pad):
    tally = run(Estimator(pad, "full"), cases.three_inside, cases.CONE, 300, np.random.default_rng(5))
    print("seed 5", tally.counts)
    assert tally.right(3) >= 0.95


def test_cross_talk_of_rows_and_columns_makes_no_second_finger(pad):
    skin = pad.with_law(shipped_law())
    estimator, rng = Estimator(skin, "full"), np.random.default_rng(6)
    more = 0
    for _ in range(100):
        (s, a), force = rng.uniform(-0.018, 0.018, 2), rng.uniform(3.0, 15.0)
        read = pressures_under(skin, [(0, s, a, force)]).reshape(4, 4)
        read = 0.96 * read + 0.02 * (read.sum(0) + read.sum(1)[:, None])
        more += len(estimator.update(read.ravel() + 200.0 * rng.standard_normal(16), 0)) > 1
    assert more <= 3


def test_a_finger_that_fit_has_is_not_lost_where_the_law_fits_no_finger():
    law = shipped_law()
    skin = Arm.single_patch(layout("hexagon")[:, 1:]).with_law(law)
    pressed = skin.with_law(replace(law, step=law.step / 1.4, table=1.4**2 * law.table))
    estimator, rng = Estimator(skin, "full"), np.random.default_rng(7)
    for _ in range(20):
        at, way = rng.uniform(-0.015, 0.015, 2), rng.uniform(0.0, 2.0 * np.pi)
        places = at, at + 0.029 * np.array([np.cos(way), np.sin(way)])
        forces = rng.uniform(4.0, 8.0, 2)
        p = pressures_under(pressed, [(0, *place, f) for place, f in zip(places, forces, strict=True)])
        p += 200.0 * rng.standard_normal(len(p))
        assert len(estimator.update(p, 0)) >= len(estimator.update(p, 0, level="fit"))
