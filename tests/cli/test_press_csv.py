"""Readings in a table of presses are those of the board, whatever its file holds by then."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from skinbus.cli.press_csv import read_presses, reading_cells, reading_columns
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError
from skinbus.model import Arm

COUNTS = 160 * np.arange(16)
NOISE = 10.0


@pytest.fixture
def arm():
    """A board that was calibrated."""
    pad = load_arm("pad")
    (placed,) = pad.patches
    patch = replace(placed.patch, gain=np.linspace(0.8, 1.2, 16))
    return Arm(pad.name, pad.links, [replace(placed, patch=patch)], *pad.buses)


def read(arm, path, columns, cells):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([["node_id", "s_mm", "a_mm", *columns], [1, 20.0, 3.0, *cells]])
    (press,) = read_presses(arm, path)
    return press


def test_counts_and_the_same_in_pascals_are_the_same_press_on_a_calibrated_board(arm, tmp_path):
    step = arm.patches[0].patch.transducer.step
    counted = read(
        arm,
        tmp_path / "c.csv",
        [*(f"c{k + 1}" for k in range(16)), *(f"n{k + 1}" for k in range(16))],
        [*COUNTS, *[NOISE] * 16],
    )
    measured = read(arm, tmp_path / "p.csv", reading_columns(16), [*COUNTS * step, *[NOISE * step] * 16])
    np.testing.assert_allclose(measured.readings, COUNTS * step * arm.tactel_gain)
    np.testing.assert_allclose(measured.readings, counted.readings)
    np.testing.assert_allclose(measured.noise, counted.noise)


def test_what_is_written_before_and_read_after_a_calibration_does_not_change(arm, tmp_path):
    pad = load_arm("pad")
    before = 1e3 * np.arange(16.0)
    cells = reading_cells(before, np.full(16, 90.0), pad.tactel_gain, 16)
    press = read(arm, tmp_path / "presses.csv", reading_columns(16), cells)
    np.testing.assert_allclose(press.readings, before * arm.tactel_gain)
    again = reading_cells(press.readings, press.noise, arm.tactel_gain, 16)
    assert again == cells


@pytest.mark.parametrize("column", ["c1", "n1"])
def test_a_reading_beyond_any_converter_is_a_fault_of_its_line(arm, tmp_path, column):
    names = ["node_id", "s_mm", "a_mm", "force_n", *(f"{kind}{k + 1}" for kind in "cn" for k in range(16))]
    values = ["1", "25", "0", "5", *["100"] * 16, *["1"] * 16]
    values[names.index(column)] = "1e308"
    path = tmp_path / "presses.csv"
    path.write_text(",".join(names) + "\n" + ",".join(values) + "\n")
    with pytest.raises(ConfigError, match=rf"{column[0]}1 ...: is 1e\+308; wanted at most"):
        read_presses(arm, path)
