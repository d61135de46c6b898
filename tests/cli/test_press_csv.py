"""Readings in a table of presses are those of the board, whatever its file holds by then."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from skinbus.cli.press_csv import read_presses, write_presses
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError
from skinbus.estimate.calibration.table import Press
from skinbus.model import Arm
from tests.files import put
from tests.two_buses import two_buses


@pytest.fixture
def arm():
    """A board that was calibrated."""
    pad = load_arm("pad")
    (placed,) = pad.patches
    patch = replace(placed.patch, gain=np.linspace(0.8, 1.2, 16))
    return Arm(pad.name, pad.links, [replace(placed, patch=patch)], *pad.buses)


def test_what_is_written_before_and_read_after_a_calibration_does_not_change(arm, tmp_path):
    pad = load_arm("pad")
    before = 1e3 * np.arange(16.0)
    path = tmp_path / "presses.csv"
    write_presses(path, pad, [Press(0, 0.02, 0.003, 5.0, before, noise=np.full(16, 90.0))])
    (press,) = read_presses(arm, path)
    np.testing.assert_allclose(press.readings, before * arm.tactel_gain)
    text = path.read_text()
    write_presses(path, arm, [press])
    assert path.read_text() == text


READ = ("node_id", "s_mm", "a_mm", "force_n", *(f"p{k + 1}" for k in range(16)))


def patches(tmp_path, second, rows, columns=(*READ, "bus")):
    """The patches of rows (node-ID, bus) in a file, of which ``columns`` are written."""
    arm = two_buses(("upper", 1, 25.0), ("grip", second, 76.0), names=("upper", "grip"))
    put(tmp_path, "arm.toml", arm)
    with (tmp_path / "presses.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, columns, extrasaction="ignore")
        table.writeheader()
        table.writerows(
            {"node_id": n, "s_mm": 20 + k, "a_mm": 3, "force_n": 5, "p1": 900.0, "bus": b}
            for k, (n, b) in enumerate(rows)
        )
    arm = load_arm(tmp_path / "arm.toml")
    return [press.patch for press in read_presses(arm, tmp_path / "presses.csv")]


def test_boards_of_all_buses_may_be_in_one_file_though_their_node_ids_repeat(tmp_path):
    assert patches(tmp_path, 1, [(1, "grip"), (1, "upper"), (1, "grip")]) == [1, 0, 1]
    with pytest.raises(ConfigError, match=r"line 2, node_id: is '1'; .* a column bus with upper or grip"):
        patches(tmp_path, 1, [(1, "")], READ)


def test_node_ids_that_differ_need_no_bus_and_a_wrong_one_is_a_fault(tmp_path):
    assert patches(tmp_path, 2, [(1, "upper"), (2, "grip")]) == [0, 1]
    with pytest.raises(ConfigError, match=r"line 3, node_id: is '2 of bus upper'; wanted a patch of the arm"):
        patches(tmp_path, 2, [(2, "grip"), (2, "upper"), (1, "upper")])
