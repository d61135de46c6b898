"""The demo holds contacts against the truth, and ends with what its figures mean."""

from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from skinbus.cli import group
from skinbus.cli.commands.demo import SETTLE, Score, verdict
from skinbus.estimate import TrackState
from skinbus.study.arm_study import GATE

TOUCH = SimpleNamespace(link="a", point=(0.0, 0.0, 0.0), force=5.0)


def contact(x=0.001, force=5.0, state=TrackState.HELD, link="a"):
    return SimpleNamespace(link=link, point=(x, 0.0, 0.0), force=force, state=state)


def score_of(*contacts, truth=(TOUCH,), fresh_ns=1):
    score = Score()
    cycle = SimpleNamespace(
        truth=truth,
        contacts=contacts,
        t_ns=1,
        patch_records={"last_fresh_ns": np.array([fresh_ns])},
    )
    for _ in range(2 * SETTLE + 1):
        score.add(cycle)
    return score


@pytest.mark.parametrize(
    ("contacts", "found", "false"),
    [
        ((contact(0.003),), 1, 0),
        ((), 0, 0),
        ((contact(GATE + 1e-3),), 0, 1),
        ((contact(link="b"),), 0, 1),
        ((contact(), contact(0.002)), 1, 1),
        ((contact(state=TrackState.COAST),), 0, 0),
    ],
)
def test_contacts_are_found_missed_or_false(contacts, found, false):
    score = score_of(*contacts)
    assert (score.n_touches, score.n_found, score.n_false) == (1, found, false)


def test_matching_is_best_in_sum_not_greedy():
    truth = (TOUCH, SimpleNamespace(link="a", point=(0.016, 0.0, 0.0), force=5.0))
    score = score_of(contact(0.010), contact(0.030), truth=truth)  # greedy: 6 mm, and a pair beyond the gate
    assert (score.n_found, score.n_false) == (2, 0)


def test_cycles_with_lost_boards_and_in_which_a_force_changes_are_not_judged():
    assert score_of(contact(), fresh_ns=0).n_touches == 0
    score = score_of(contact())
    pressed = SimpleNamespace(
        **vars(score.last[0]) | {"truth": (SimpleNamespace(**vars(TOUCH) | {"force": 6.0}),)}
    )
    score.add(pressed)
    assert score.n_touches == 1


def test_the_end_says_what_was_found_and_what_to_do():
    assert verdict(score_of(contact(0.003))) == "Every touch was found and no contact was false."
    assert score_of(contact(0.003, 5.5)).spread() == [[3.0, 3.0], [10.0, 10.0]]
    off = verdict(score_of(contact(0.003, 8.0)))
    assert "Forces are off by up to 60 %" in off
    assert "skinbus calibrate" in off
    assert verdict(score_of(contact(0.03))).startswith("1 of 1 touches in cycles missed, 1 contact false")
    assert verdict(score_of(truth=())).startswith("No touch was measured")


@pytest.mark.slow
def test_demo_finds_every_touch():
    result = CliRunner().invoke(group, ["demo"])
    assert result.exit_code == 0, result.output
    assert "Every touch was found and no contact was false." in result.output
