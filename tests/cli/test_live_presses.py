"""`skinbus calibrate live` on a bus: presses are asked for, kept, and gone on with."""

import csv
import os

import pytest

from tests.cli.commands.pressed_pad import pressed_pad
from tests.cli.patience import until_in_time


@pytest.fixture
def calibrate(own_bus, tmp_path):
    def run(*more, text="", then=None, is_pressed=False):
        with pressed_pad(own_bus, then) as (_, hand):
            if is_pressed:
                hand.start()
            return own_bus.run("calibrate", "live", "pad", tmp_path / "presses.csv", *more, text=text)

    return run


@pytest.mark.slow
def test_presses_are_kept_one_by_one_and_the_next_run_goes_on(calibrate, tmp_path):

    def run_again():
        (tmp_path / "presses.csv").unlink(missing_ok=True)
        reading, writing = os.pipe()

        def leave():
            with os.fdopen(writing, "wb") as answers:
                answers.write(b"quit\n")

        with os.fdopen(reading, "rb") as text:
            return calibrate("--weight-n", "8", text=text, is_pressed=True, then=leave)

    # without it all five were too short for a busy machine
    result = until_in_time(run_again, lambda result: "mm from there" in result.output)
    assert result.exit_code == 1, result.output
    assert "node 1: press at s 25.0 mm, a 0.0 mm" in result.output  # it is pressed there, and only there
    assert "mm from there" in result.output
    with (tmp_path / "presses.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["s_mm"], row["a_mm"], row["force_n"]) == ("25", "0", "8")
    assert float(row["p6"]) > 1e3
    again = calibrate("--weight-n", "8", text="quit\n")
    assert "1 press from before" in again.output
    other = calibrate("--weight-n", "5", text="quit\n")
    assert (other.exit_code, "another force" in other.output) == (2, True)


def test_a_file_of_others_is_kept_and_done_without_a_press_is_status_1(calibrate, tmp_path):
    (tmp_path / "presses.csv").write_text("node_id,s_mm,a_mm,force_n,c1\n1,25,0,5,300\n")
    assert "was not made by `calibrate live`" in calibrate(text="done\n").output
    (tmp_path / "presses.csv").unlink()
    result = calibrate(text="done\n")
    assert result.exit_code == 1
