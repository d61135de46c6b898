"""The demo ends with what its figures mean."""

from skinbus.cli.commands.demo import verdict

GOOD = {"touches": 5, "missed": 0, "false": 0, "force_pct": {"median": 3.0, "p95": 8.0}}


def test_demo_that_found_everything_says_so_and_nothing_else():
    assert verdict(GOOD) == "Every touch was found and no contact was false."


def test_forces_that_are_off_name_their_cause_and_what_to_do():
    text = verdict(GOOD | {"force_pct": {"median": 3.0, "p95": 33.0}})
    assert "Every touch was found" in text
    assert "33 %" in text
    assert "skinbus calibrate" in text


def test_missed_and_false_contacts_are_counted():
    text = verdict(GOOD | {"missed": 2, "false": 1})
    assert text.startswith("2 of 5 touches missed, 1 contact false")


def test_nothing_measured_is_not_called_good():
    assert verdict(GOOD | {"touches": 0}).startswith("No touch was measured")
