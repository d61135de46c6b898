"""Presses of boards whose node-IDs repeat from bus to bus go to the bus that is named, or are refused."""

import csv

import pytest

from skinbus.cli.bus_presses import read_bus_presses
from skinbus.config.system import load_arm
from skinbus.errors import AddressError, ConfigError

ARM = """
[arm]
name = "two"
[[bus]]
name = "upper"
[[bus]]
name = "grip"
[[link]]
name = "plate"
surface = "plane"
length_mm = 110.0
width_mm = 60.0
[[patch]]
bus = "upper"
node_id = 1
link = "plate"
s_mm = 25.0
[[patch]]
bus = "grip"
node_id = {second}
link = "plate"
s_mm = 76.0
"""
READ = ("node_id", "s_mm", "a_mm", "force_n", *(f"p{k + 1}" for k in range(16)))


def read(tmp_path, second, rows, bus=None, columns=(*READ, "bus")):
    """The patches of rows (node-ID, bus) in a file, of which ``columns`` are written."""
    (tmp_path / "arm.toml").write_text(ARM.format(second=second))
    with (tmp_path / "presses.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, columns, extrasaction="ignore")
        table.writeheader()
        table.writerows(
            {"node_id": n, "s_mm": 20, "a_mm": 3, "force_n": 5, "p1": 900.0, "bus": b} for n, b in rows
        )
    arm = load_arm(tmp_path / "arm.toml")
    return [press.patch for press in read_bus_presses(arm, tmp_path / "presses.csv", bus)]


@pytest.mark.parametrize("bus", [None, "grip"])
def test_a_column_names_the_bus_and_an_option_agrees(tmp_path, bus):
    assert read(tmp_path, 1, [(1, "grip"), (1, "grip")], bus) == [1, 1]


def test_an_option_names_the_bus_of_a_file_without_the_column(tmp_path):
    assert read(tmp_path, 1, [(1, "")], "grip", READ) == [1]
    assert read(tmp_path, 1, [(1, "")], "upper", READ) == [0]
    with pytest.raises(ConfigError, match="column bus: wanted it, or --bus, as"):
        read(tmp_path, 1, [(1, "")], None, READ)
    with pytest.raises(AddressError, match="upper, grip"):
        read(tmp_path, 1, [(1, "")], "hand", READ)


def test_node_ids_that_differ_need_no_bus_and_a_wrong_one_is_a_fault(tmp_path):
    assert read(tmp_path, 2, [(1, "upper"), (2, "grip")]) == [0, 1]
    with pytest.raises(ConfigError, match=r"line 3, bus: is 'upper'; wanted grip, which has node 2"):
        read(tmp_path, 2, [(2, "grip"), (2, "upper"), (1, "upper")])


@pytest.mark.parametrize(
    ("rows", "bus", "said"),
    [
        ([(1, "grip"), (1, "uper")], None, "line 3, bus: is 'uper'; wanted upper or grip"),
        ([(1, "grip"), (1, "upper")], None, "wanted a file for each bus"),
        ([(1, "grip"), (1, "upper")], "grip", "line 3, bus: is 'upper'; wanted grip, as --bus says"),
    ],
)
def test_rows_whose_bus_is_not_clear_are_refused(tmp_path, rows, bus, said):
    with pytest.raises(ConfigError, match=said):
        read(tmp_path, 1, rows, bus)
