"""The demo ends with what its figures mean."""

from skinbus.cli.commands.demo import verdict
from skinbus.sim.bare_skin import Gap

GOOD = {"touches": 5, "missed": 0, "false": 0, "force_pct": {"median": 3.0, "p95": 8.0}}


def test_demo_that_found_everything_says_so_and_nothing_else():
    assert verdict(GOOD) == "Every touch was found and no contact was false."


def test_forces_that_are_off_name_their_cause_and_what_to_do():
    text = verdict(GOOD | {"force_pct": {"median": 3.0, "p95": 33.0}})
    assert "Every touch was found" in text
    assert "33 %" in text
    assert "skinbus calibrate" in text


def test_a_gap_between_boards_is_named_where_something_is_off():
    gap = [Gap(1, "tube", 0.0501, 0.031, 0.0119)]
    text = verdict(GOOD | {"force_pct": {"median": 3.0, "p95": 76.0}}, gap)
    assert "touch 1 at s 50 mm, a 31 mm of tube is 12 mm off the nearest board" in text
    assert "skinbus calibrate" not in text
    assert verdict(GOOD, gap) == verdict(GOOD)


def test_missed_and_false_contacts_are_counted():
    text = verdict(GOOD | {"missed": 2, "false": 1})
    assert text.startswith("2 of 5 touches missed, 1 contact false")
