"""Arm files by themselves: what the text alone tells, and faults instead of exceptions for any tables."""

import math

import pytest

from skinbus.config.arm_file import read_arm_file
from skinbus.model import BusSettings
from tests.files import put

TEXT = """
[arm]
name = "both"
bitrate = 500_000
rate_hz = 20

[[link]]
name = "table"
surface = "plane"
length_mm = 100
width_mm = 200

[[link]]
name = "horn"
surface = "cone"
length_mm = 100
radius_near_mm = 80
radius_far_mm = 60

[[patch]]
node_id = 5
link = "table"
s_mm = 50
a_mm = -20
yaw_deg = 90
eds = "other"
serial = 0x1234
[patch.set]
"Touch Pa" = 1500
"0x2030:01" = 1500

[[ring]]
link = "horn"
s_mm = 50
count = 4
first_node_id = 10
angle_deg = 45
"""


def read(tmp_path, text):
    return read_arm_file(put(tmp_path, "x.toml", text))


def test_everything_in_the_file_is_read_in_si_units(tmp_path):
    file = read(tmp_path, TEXT)
    assert file.faults == []
    assert (file.name, file.buses) == ("both", (BusSettings(bitrate=500_000, rate_hz=20.0),))
    plane, cone = (link.build() for link in file.links)
    assert (plane.kind, plane.length, plane.width) == ("plane", 0.1, 0.2)
    assert (cone.kind, cone.length) == ("cone", 0.1)
    assert cone.radius_at([0.0, 0.1]) == pytest.approx([0.08, 0.06])
    patch, *ring = file.mountings
    board = patch.board
    assert (board.node_id, patch.link, board.s_mm, board.yaw_deg) == (5, 0, 50, 90)
    assert file.links[0].across(board) == -0.02
    assert (board.eds, board.serial) == ("other", 0x1234)
    assert board.set == {"Touch Pa": 1500, "0x2030:01": 1500}
    assert [m.board.node_id for m in ring] == [10, 11, 12, 13]
    around = [file.links[m.link].across(m.board) / (0.07 * math.pi / 4) for m in ring]
    assert around == pytest.approx([1.0, 3.0, -3.0, -1.0])
    assert {m.board.eds for m in ring} == {"skin-patch"}
    assert [m.key for m in file.mountings] == ["patch[1]", *(f"ring[1]#{k}" for k in (1, 2, 3, 4))]


CANFD = [
    # [arm], [[bus]], data bit rate of each bus
    ("canfd = true", ["", ""], [2_000_000, 2_000_000]),
    ("canfd = true\ndata_bitrate = 5_000_000", ["", "canfd = false"], [5_000_000, None]),
    ("", ["canfd = true", "canfd = true\ndata_bitrate = 8_000_000"], [2_000_000, 8_000_000]),
    ("data_bitrate = 4_000_000", ["canfd = true", ""], [4_000_000, None]),
    ("data_bitrate = 2_000_000", ["", "canfd = false"], [None, None]),
]


def with_buses(arm, buses):
    text = TEXT.replace("rate_hz = 20\n", f"rate_hz = 20\n{arm}\n").replace(
        "[[ring]]", '[[ring]]\nbus = "b1"'
    )
    text = text.replace("[[patch]]", '[[patch]]\nbus = "b0"')
    return text + "".join(f'\n[[bus]]\nname = "b{k}"\n{keys}\n' for k, keys in enumerate(buses))


@pytest.mark.parametrize(("arm", "buses", "wanted"), CANFD)
def test_can_fd_is_said_for_the_arm_or_for_a_bus(tmp_path, arm, buses, wanted):
    file = read(tmp_path, with_buses(arm, buses))
    assert file.faults == []
    assert [bus.data_bitrate for bus in file.buses] == wanted
