"""The score: what counts as found, missed and false."""

import numpy as np
import pytest

from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface
from skinbus.study.score import Points, Score

CYLINDER = Surface.cylinder(0.1, 0.05)


@pytest.fixture
def score():
    placed = [PlacedPatch(patch=Patch.default(), node_id=1, link=0, s=0.05, a=0.0)]
    return Score(Arm("test", [Link("a", CYLINDER), Link("b", CYLINDER)], placed))


def points(*rows):
    """Rows of (id, link, s, a, force)."""
    table = np.array(rows, float).reshape(-1, 5)
    return Points(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2], table[:, 3], table[:, 4])


def test_contact_near_a_touch_finds_it_and_is_measured(score):
    score.add(points((0, 0, 0.05, 0.01, 4.0)), points((9, 0, 0.053, 0.014, 5.0)))
    assert (score.touches, score.missed, score.false) == (1, 0, 0)
    assert score.position_mm() == {"median": 5.0, "p95": 5.0}
    assert score.force_pct() == {"median": 25.0, "p95": 25.0}


def test_distance_goes_the_short_way_round(score):
    half = 0.5 * CYLINDER.period
    score.add(points((0, 0, 0.05, half - 0.001, 4.0)), points((9, 0, 0.05, -half + 0.001, 4.0)))
    assert score.position_mm()["median"] == pytest.approx(2.0)


@pytest.mark.parametrize(
    "contact", [(9, 0, 0.05, 0.05, 4.0), (9, 1, 0.05, 0.01, 4.0)], ids=["far", "other link"]
)
def test_contact_elsewhere_is_false_and_the_touch_missed(score, contact):
    score.add(points((0, 0, 0.05, 0.01, 4.0)), points(contact))
    assert (score.missed, score.false) == (1, 1)


def test_two_contacts_on_one_touch_are_one_found_and_one_false(score):
    score.add(points((0, 0, 0.05, 0.0, 4.0)), points((1, 0, 0.05, 0.001, 4.0), (2, 0, 0.05, 0.002, 4.0)))
    assert (score.missed, score.false) == (0, 1)


def test_touch_seen_in_too_few_cycles_is_missed(score):
    touch, contact = points((0, 0, 0.05, 0.0, 4.0)), points((1, 0, 0.05, 0.0, 4.0))
    for n in range(10):
        score.add(touch, contact if n < 8 else points())
    assert score.missed == 1


def test_contact_is_false_once_however_long_it_stays(score):
    for _ in range(5):
        score.add(points(), points((7, 0, 0.05, 0.0, 4.0)))
    assert score.false == 1


def test_matching_is_best_in_sum_not_greedy(score):
    touches = points((0, 0, 0.05, 0.000, 4.0), (1, 0, 0.05, 0.016, 4.0))
    contacts = points((5, 0, 0.05, 0.010, 4.0), (6, 0, 0.05, 0.030, 4.0))
    score.add(touches, contacts)  # greedy would give 6 mm and a pair beyond the gate
    assert (score.missed, score.false) == (0, 0)
