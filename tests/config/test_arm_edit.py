"""Edits of an arm file change what they are to change and nothing else, or are refused."""

import random
import tomllib
from contextlib import suppress

import pytest

from skinbus.config.arm_edit import edit_arm
from skinbus.config.arm_file import check_tables, find_arm
from skinbus.errors import ConfigError

FILE = """# An arm of our laboratory.
[arm]
name = "lab"   # [[patch]] in a comment is none

[[link]]
name = "forearm [[ring]]"
surface = "cylinder"
length_mm = 154.0
radius_mm = 64.9352  # 8 x 51 mm around

# the ring at the wrist
[[ring]]
link = "forearm [[ring]]"
s_mm = 26.0     # from the drawing
# mounted in May
count = 2
first_node_id = 1
eds = [
  "a.dcf",  # the first
  "b.dcf",
]
set = { "Thresholds/Touch Pa" = 1_500 }

# the elbow
[[patch]]
  node_id = 9   # was 7
  link = "forearm [[ring]]"
  s_mm = 1_28.0 # mm
  angle_deg = -3e1
[patch.set]
"Touch Pa" = 1200

# another ring
[[ring]]
link = "forearm [[ring]]"
s_mm = 76
count = 4
first_node_id = 20
"""


def mountings(text, tmp_path):
    file = check_tables(tomllib.loads(text), tmp_path / "arm.toml")
    assert file.faults == []
    return {m.board.node_id: m.board for m in file.mountings}


@pytest.fixture
def edit(tmp_path):
    return lambda text, changes: edit_arm(tmp_path / "arm.toml", text, changes)


def test_values_change_and_all_else_stays(edit):
    edited = edit(FILE, {"patch[1]": {"node_id": 17, "s_mm": 127.25, "yaw_deg": 90.0}})
    before, _, rest = FILE.partition("[[patch]]\n  node")
    table = """[[patch]]
node_id = 17
link = "forearm [[ring]]"
s_mm = 127.25
angle_deg = -30.0
set = { "Touch Pa" = 1200 }
yaw_deg = 90.0
"""
    assert edited == before + table + rest[rest.index("\n# another ring") :]


def test_nothing_changes_without_a_change(edit):
    assert edit(FILE, {}) == FILE
    assert edit(FILE.replace("\n", "\r\n"), {}) == FILE.replace("\n", "\r\n")


def test_a_ring_becomes_patches_where_it_stood(edit, tmp_path):
    edited = edit(FILE, {"ring[1]#2": {"node_id": 40, "yaw_deg": -90.0, "serial": 7}})
    before, after = mountings(FILE, tmp_path), mountings(edited, tmp_path)
    assert set(after) == set(before) - {2} | {40}
    assert (after[1].s_mm, after[1].angle_deg, after[1].eds) == (before[1].s_mm, before[1].angle_deg, "a.dcf")
    assert (after[40].angle_deg, after[40].eds, after[40].serial) == (before[2].angle_deg, "b.dcf", 7)
    assert after[40].set == before[2].set
    where = [edited.index(words) for words in ("wrist", "May", "b.dcf", "the elbow", "another ring")]
    assert where == sorted(where)


def test_a_ring_with_a_table_of_settings_becomes_patches_that_each_have_it(edit, tmp_path):
    text = FILE.replace("first_node_id = 20\n", 'first_node_id = 20\n[ring.set]\n"Touch Pa" = 900\n')
    after = mountings(edit(text, {"ring[2]#1": {"yaw_deg": 5.0}}), tmp_path)
    assert all(after[k].set == {"Touch Pa": 900} for k in range(20, 24))


@pytest.mark.parametrize(
    "text",
    [
        FILE.replace("node_id = 9", '"node_id" = 9'),
        FILE.replace("[[patch]]", '[["patch"]]'),
        FILE.replace("  node_id = 9   # was 7\n", "").replace("[patch.set]", "[patch.set]\nnode_id = 4"),
    ],
)
def test_what_is_written_in_another_way_is_refused_or_right(edit, text):
    """Never spoilt: in the last one the key is added where it belongs."""
    with suppress(ConfigError):
        edited = tomllib.loads(edit(text, {"patch[1]": {"node_id": 5}}))
        assert edited["patch"][0]["node_id"] == 5
        assert edited["patch"][0]["set"] == tomllib.loads(text)["patch"][0]["set"]


@pytest.mark.parametrize("name", ["arm", "arm-two-buses", "forearm", "pad"])
def test_shipped_arms_take_any_change(name, edit, tmp_path):
    rng = random.Random(f"edit {name}")
    text = find_arm(name).read_text()
    old = list(check_tables(tomllib.loads(text), find_arm(name)).mountings)
    changes = {
        m.key: {"yaw_deg": round(rng.uniform(-180, 180), 3)} for m in rng.sample(old, len(old) // 2 + 1)
    }
    new = check_tables(tomllib.loads(edit(text, changes)), find_arm(name))
    assert not new.faults
    yaws = sorted(m.board.yaw_deg for m in new.mountings if m.board.yaw_deg)
    assert yaws == sorted(change["yaw_deg"] for change in changes.values() if change["yaw_deg"])
    assert [line for line in text.splitlines() if line.startswith("#")] == [
        line for line in edit(text, changes).splitlines() if line.startswith("#")
    ]
