"""Beyond the outermost tactels, and under what is not round, contacts are true within their sd or flagged."""

import zlib

import numpy as np
import pytest

from skinbus.estimate import Estimator, Quality
from skinbus.study.skin_models import pad_tip
from tests.estimate.rim_presses import BARS, DISCS, RimPresses
from tests.estimate.sized_presses import SizedPresses

BOARD = 0.010
"""m, from the outermost tactels to the edge of the board."""


def totals(name, level, n, seed=23):
    """Return contacts without a flag, and how many are beyond 3 and 6 sd, inside the tactels and outside."""
    tallies = RimPresses((DISCS | BARS)[name], seed=seed).measure(level, n, BOARD)
    parts = tallies[:2], tallies[2:]
    return [
        [sum(len(t.place) for t in part), *(sum(t.beyond(k) for t in part) for k in (3, 6))] for part in parts
    ]


@pytest.mark.parametrize("level", ["fit", "full"])
@pytest.mark.parametrize("name", DISCS)
def test_fingers_over_a_rim_are_true_within_their_covariance_or_flagged(name, level):
    inside, outside = totals(name, level, 300)
    print("seed 23, contacts, beyond 3, beyond 6:", inside, outside)
    assert inside[0] > 60
    assert inside[1:] == [0, 0]
    assert outside[1] <= 0.05 * outside[0]
    assert outside[2] <= 0.03 * outside[0]


def test_bars_on_boards_and_over_rims_are_true_within_their_covariance_or_flagged():
    inside, outside = totals("bar 15x8", "fit", 300)
    print("seed 23, contacts, beyond 3, beyond 6:", inside, outside)
    assert inside[1] <= 0.06 * inside[0]
    assert outside[1] <= 0.1 * outside[0]
    assert outside[2] == 0


def test_bars_over_rims_that_read_like_fingers_are_true_within_their_covariance_or_flagged():
    inside, outside = totals("bar 25x10", "fit", 600)
    print("seed 23, contacts, beyond 3, beyond 6:", inside, outside)
    assert inside[0] + outside[0] > 60
    assert inside[1] + outside[1] <= 0.15 * (inside[0] + outside[0])
    assert inside[2] + outside[2] == 0


def test_equal_readings_but_for_noise_give_equal_forces_of_small_discs():
    presses = SizedPresses(8.0)
    rng, estimator = np.random.default_rng(1), Estimator(presses.arm, "fit")
    jumps = []
    for k in range(1500):
        touch = np.array([*rng.uniform(-0.010, 0.010, 2), rng.uniform(3.0, 10.0)])
        touch[0] += presses.arm.tactel_s.mean()
        felt = presses.clean(touch) * (1.0 + 0.03 * rng.standard_normal(presses.arm.n_tactels))
        pair = [estimator.update(felt + 200.0 * rng.standard_normal(len(felt)), k) for _ in range(2)]
        if all(len(c) == 1 and not c.quality[0] for c in pair):
            least = min(np.sqrt(c.covariance[0, 2, 2]) for c in pair)
            jumps.append(abs(pair[0].force[0] - pair[1].force[0]) / least)
    print("seed 1:", len(jumps), np.max(jumps))
    assert len(jumps) > 1200
    assert np.max(jumps) <= 4.0
    assert np.mean(np.array(jumps) > 3.0) <= 2e-3


def test_a_misfit_that_grows_with_the_force_makes_no_strong_answer_likely():
    skin = pad_tip(np.random.default_rng([90000, 2, zlib.crc32(b"tip two 15 mm")]))
    readings = [
        -784,
        -238,
        3931,
        2396,
        1209,
        357,
        19252,
        15795,
        247,
        365,
        1569,
        43844,
        -641,
        -850,
        1650,
        4089,
    ]
    contacts = Estimator(skin.arm, "full").update(readings, 0)  # of two tips of 5 N
    assert len(contacts) == 2
    assert contacts.force.max() < 8.0


def test_a_force_that_the_tactels_do_not_determine_is_flagged():
    presses = RimPresses(DISCS["finger 12"], seed=23)
    arm, layer, _ = presses.skins[0]
    place = arm.tactel_s.max() + 0.011, arm.tactel_a[0] + 0.001
    contacts = Estimator(arm, "fit").update(layer.feel(*place, 15.0), 0)
    assert len(contacts) == 1
    assert contacts.quality[0] & Quality.FEW_TACTELS
