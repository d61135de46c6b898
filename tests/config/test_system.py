"""Arms from files: the shipped ones fit their bus and their links; every fault of a wrong one is said."""

import re

import numpy as np
import pytest

from skinbus.config.arm_file import find_arm
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import ConfigError
from skinbus.objects import cia
from skinbus.objects.bus_load import MAX_LOAD, cyclic_load
from skinbus.objects.dcf import download_plan
from skinbus.objects.eds import find_eds
from tests.files import put

SHIPPED = {
    "pad": (1, 16, 16),
    "forearm": (24, 384, 16),
    "arm": (48, 768, 8),
    "arm-two-buses": (48, 768, 16),
}

GOOD = """
[arm]
name = "test"

[[link]]
name = "tube"
surface = "cylinder"
length_mm = 200.0
radius_mm = 50.0

[[patch]]
node_id = 1
link = "tube"
s_mm = 30.0

[[ring]]
link = "tube"
s_mm = 100.0
count = 6
first_node_id = 11
"""


LINK = '[[link]]\nname = "tube"\nsurface = "plane"\nlength_mm = 1.0\nwidth_mm = 1.0\n\n'


def load(tmp_path, text):
    return load_arm(put(tmp_path, "arm.toml", text))


def faults(tmp_path, text):
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text)
    assert caught.value.file.endswith("arm.toml")
    return [str(fault) for fault in caught.value.faults]


@pytest.mark.parametrize(("name", "sizes"), SHIPPED.items())
def test_shipped_arm_loads_and_fits_its_bus(name, sizes):
    arm = load_arm(name)
    assert (arm.n_patches, arm.n_tactels, arm.patches[0].patch.transducer.bits) == sizes
    for bus in range(len(arm.buses)):
        node_ids = arm.node_id[arm.patches_on(bus)]
        assert list(node_ids) == list(range(1, len(node_ids) + 1))
        assert cyclic_load(arm, ods_of(arm), bus) <= MAX_LOAD


def test_every_fault_of_a_file_is_said_at_once(tmp_path):
    text = """
[arm]
name = "test"
bitrate = 123
colour = "red"

[[link]]
name = "tube"
surface = "cylinder"
length_mm = -1.0

[[link]]
name = "sheet"
surface = "plane"
length_mm = 100.0

[[patch]]
node_id = 127
link = "tube"
s_mm = "here"

[[patch]]
node_id = 3
link = "nowhere"
s_mm = 1.0

[[ring]]
link = "sheet"
s_mm = 50.0
count = 8
first_node_id = 120

[extra]
"""
    said = faults(tmp_path, text)
    for key in [
        "arm.bitrate: is 123; wanted 125000",
        "arm.colour: is 'red'; wanted no such key",
        "link[1].length_mm: is -1.0; wanted greater than or equal to 1",
        "link[1].radius_mm: wanted a value",
        "link[2].width_mm: wanted a value",
        "patch[1].node_id: is 127; wanted a node-ID from 1 to 126; 127 is that of the master",
        "patch[1].s_mm: is 'here'; wanted a number",
        "patch[2].link: is 'nowhere'; wanted the name of a link: tube, sheet",
        "ring[1].count: is 8; wanted node-IDs up to 126, not 127",
        "extra: wanted one of arm, bus, guard, joint, link, patch, ring, robot",
    ]:
        assert any(line.startswith(key) for line in said), (key, said)
    assert len(said) == 10


TWO_BUSES = """
[arm]
name = "test"
rate_hz = 20.0

[[bus]]
name = "left"
bitrate = 500_000
channel = "can0"

[[bus]]
name = "right"
interface = "udp_multicast"

[[link]]
name = "tube"
surface = "cylinder"
length_mm = 200.0
radius_mm = 50.0

[[ring]]
bus = "right"
link = "tube"
s_mm = 30.0
count = 2
first_node_id = 1

[[ring]]
bus = "left"
link = "tube"
s_mm = 100.0
count = 3
first_node_id = 1
"""

WRONG = """
node_id = 1 => node_id = 11
    -> ring[1]#1.node_id: is 11; wanted another: patch[1] has it
s_mm = 30.0 => s_mm = 10.0
    -> patch[1]: wanted a place where it does not stick out 15.0 mm beyond link 'tube'
s_mm = 30.0 => s_mm = 60.0
    -> patch[1] and ring[1]#1: is '10.0 mm of overlap'
count = 6 => count = 8
    -> ring[1]#1 and ring[1]#2: is '10.7 mm of overlap'
radius_mm = 50.0 => radius_mm = 50.0 ; width_mm = 3.0
    -> link[1].width_mm: is 3.0; wanted no such key
radius_mm = 50.0 =>
    -> link[1].radius_mm: wanted a value; it has no default
s_mm = 30.0 => s_mm = 30.0 ; a_mm = 3.0
    -> patch[1].a_mm: is 3.0; wanted no such key on a cylinder
name = "test" => name = "test" ; rate_hz = 200.0
    -> arm.rate_hz: is 200.0; wanted at most 130.3
name = "test" => name = "test" ; rate_hz = 0.9
    -> arm.rate_hz: is 0.9; wanted greater than or equal to 1
name = "test" => name = "test" ; sync_counter = 1
    -> arm.sync_counter: is 1; wanted 0, or 2 to 240
name = "test" => name = "test" ; sync_counter = 241
    -> arm.sync_counter: is 241; wanted less than or equal
name = "test" => name = "test" ; sdo_timeout_ms = 0
    -> arm.sdo_timeout_ms: is 0; wanted greater than
name = "test" => name = "test" ; rate_hz = nan
    -> arm.rate_hz: is nan; wanted a finite number
s_mm = 30.0 => s_mm = 30.0 ; eds = "skin-pitch"
    -> patch[1].eds skin-pitch EDS: wanted an EDS
s_mm = 30.0 => s_mm = 30.0 ; eds = "no.eds"
    -> patch[1].eds
s_mm = 30.0 => s_mm = 30.0 ; eds = "skin-master"
    -> patch[1].eds skin-master Board/Tactel count: wanted
[[link]] ; name = "tube" => [[link]]
    -> link[1].name: wanted a value
node_id = 1 =>
    -> patch[1].node_id: wanted a value
node_id = 1 => node_id = true
    -> patch[1].node_id: is True; wanted a whole number
[[link]] => [[lnik]]
    -> lnik: *did you mean 'link'?
name = "test" => name = "test" ; canfd = true ; data_bitrate = 3_000_000
    -> arm.data_bitrate: is 3000000; wanted 1000000,
name = "test" => name = "test" ; canfd = "yes"
    -> arm.canfd: is 'yes'; wanted true or false
node_id = 1 => node_id = 1 ; bus = "left"
    -> patch[1].bus: is 'left'; wanted no such key: there is no [[bus]]
"""
"""What is changed in a good file (; is the end of a line), and what is said of it; * is anything."""
WRONG_BUSES = """
bus = "left" =>
    -> ring[2].bus: wanted the name of a bus: left, right
bus = "left" => bus = "middle"
    -> ring[2].bus: is 'middle'; wanted the name of a bus: left, right
name = "right" => name = "left"
    -> bus[2].name: is 'left'; wanted another: bus[1] has it
bus = "right" => bus = "left"
    -> ring[2]#1.node_id: is 1; wanted another: ring[1]#1 has it
interface = "udp_multicast" => channel = "can0"
    -> bus[2].channel: is 'can0'; wanted another: bus[1] has it
bitrate = 500_000 => bitrate = 3
    -> bus[1].bitrate: is 3; wanted 125000, 250000, 500000, 800000 or 1000000
name = "left" => name = "a b"
    -> bus[1].name: is 'a b'; wanted
rate_hz = 20.0 => rate_hz = 200.0
    -> arm.rate_hz: is 200.0; wanted at most *bus left would be
"""


def rows(text, table):
    """Rows of a table: a good text, what is changed in it to what, and what is said."""
    return [
        (text, old.replace(" ; ", "\n"), new.strip().replace(" ; ", "\n"), said)
        for old, new, said in re.findall(r"(.+) =>(.*)\n +-> (.+)", table)
    ]


MORE = [
    (
        GOOD,
        'surface = "cylinder"\nlength_mm = 200.0\nradius_mm = 50.0',
        'surface = "cone"\nlength_mm = 100\nradius_near_mm = 180\nradius_far_mm = 60',
        "link[1].length_mm: is 100; wanted more than 120, the change of radius",
    ),
    (
        TWO_BUSES,
        'bus = "right"\nlink = "tube"\ns_mm = 30.0\ncount = 2\nfirst_node_id = 1',
        'bus = "left"\nlink = "tube"\ns_mm = 30.0\ncount = 2\nfirst_node_id = 4',
        "bus[2].name: is 'right'; wanted a bus with patches",
    ),
    (GOOD, "[[patch]]", f"{LINK}[[patch]]", "link[2].name: is 'tube'; wanted another: link[1] has it"),
    (GOOD, "[[patch]]", f"{16 * LINK}[[patch]]", "link: is '17 tables'; wanted at most 16"),
]


@pytest.mark.parametrize(
    ("text", "old", "new", "said"),
    [*rows(GOOD, WRONG), *rows(TWO_BUSES, WRONG_BUSES), *MORE],
    ids=lambda text: text.strip()[:40],
)
def test_wrong_file_is_refused_with_key_value_and_what_is_wanted(tmp_path, text, old, new, said):
    assert old in text
    lines = faults(tmp_path, text.replace(old, new, 1))
    head, _, rest = said.partition("*")
    assert any(line.startswith(head) and rest in line for line in lines), lines


def test_empty_file_asks_for_links_and_patches(tmp_path):
    said = faults(tmp_path, "")
    assert [line.split(":")[0] for line in said] == ["arm.name", "link", "patch"]


def test_eds_path_is_relative_to_the_arm_file(tmp_path):
    put(
        tmp_path,
        "mine.eds",
        find_eds("skin-patch").read_text().replace("DefaultValue=1000\n", "DefaultValue=1500\n"),
    )
    arm = load(tmp_path, GOOD.replace("s_mm = 30.0", 's_mm = 30.0\neds = "mine.eds"'))
    assert arm.patches[0].patch.threshold == 1500.0
    assert arm.patches[1].patch.threshold == 1000.0
    assert ods_of(arm)[0]["Thresholds"]["Touch Pa"].default == 1500


def test_sync_counter_goes_to_every_patch_that_has_one(tmp_path):
    arm = load(tmp_path, GOOD.replace('name = "test"', 'name = "test"\nsync_counter = 100', 1))
    assert arm.bus.sync_counter == 100
    written = [[w for w in download_plan(od) if w.index == cia.SYNC_COUNTER_OVERFLOW] for od in ods_of(arm)]
    assert written == [[(cia.SYNC_COUNTER_OVERFLOW, 0, bytes([100]))]] * arm.n_patches


UNMAPPED = [  # settings of patch 1, and what is said of it
    ('"0x1803:01" = 0xC0000481', "4 of 16 readings in no enabled TPDO: 13, 14, 15, 16"),
    ('"0x1A00:00" = 2', "2 of 16 readings in no enabled TPDO: 3, 4"),
    (
        '"0x1803:01" = 0xC0000481\n"0x1802:01" = 0xC0000381',
        "8 of 16 readings in no enabled TPDO: 9, 10, 11, 12, ...",
    ),
    ('"0x1A00:01" = 0x64010210', "1 of 16 readings in no enabled TPDO: 1"),
    ('"0x1801:01" = 0x60000281', "4 of 16 readings in no enabled TPDO: 5, 6, 7, 8"),
]


@pytest.mark.parametrize(("settings", "said"), UNMAPPED)
def test_a_reading_that_no_enabled_tpdo_carries_is_a_fault(tmp_path, settings, said):
    text = GOOD.replace("s_mm = 30.0", f"s_mm = 30.0\n[patch.set]\n{settings}", 1)
    (line,) = faults(tmp_path, text)
    assert line.startswith(f"patch[1].eds skin-patch: is {said!r}; wanted all of them")


def test_readings_of_tactels_that_are_masked_need_not_be_sent(tmp_path):
    own = '[patch.set]\n"0x1803:01" = 0xC0000481\n"Healthy tactels" = 0x0FFF'
    arm = load(tmp_path, GOOD.replace("s_mm = 30.0", f"s_mm = 30.0\n{own}", 1))
    assert arm.tactel_healthy[:16].tolist() == [True] * 12 + [False] * 4


def test_patches_come_bus_after_bus_and_node_ids_may_repeat(tmp_path):
    arm = load(tmp_path, TWO_BUSES)
    assert [(bus.name, bus.bitrate, bus.rate_hz) for bus in arm.buses] == [
        ("left", 500_000, 20.0),
        ("right", 1_000_000, 20.0),
    ]
    assert [(bus.interface, bus.channel) for bus in arm.buses] == [(None, "can0"), ("udp_multicast", None)]
    assert list(zip(arm.patch_bus, arm.node_id, strict=True)) == [(0, 1), (0, 2), (0, 3), (1, 1), (1, 2)]
    assert (arm.patch_at(2), arm.patch_at(2, bus=1), arm.patches_named(2)) == (1, 4, [1, 4])
    right = arm.part(1)
    assert (right.n_patches, right.buses, right.patch_bus.tolist()) == (2, arm.buses[1:], [0, 0])


@pytest.mark.slow
def test_ten_faults_of_a_kind_are_listed_and_the_others_counted(tmp_path):
    with pytest.raises(ConfigError) as caught:
        load_arm(put(tmp_path, "arm.toml", "".join(f"k{i} = 1\n" for i in range(30_000))))
    said = str(caught.value)
    assert "and 29990 more like these" in said
    assert len(said) < 3000


def test_a_file_that_is_no_eds_is_not_quoted(tmp_path):
    put(tmp_path, "shadow", "root:$6$secret:19000:0:99999:7:::\n[x]\npassword=secret\n")
    with pytest.raises(ConfigError) as caught:
        load_arm(put(tmp_path, "arm.toml", find_arm("pad").read_text().replace('"skin-patch"', '"./shadow"')))
    assert "an EDS or DCF" in str(caught.value)
    assert "secret" not in str(caught.value)


def test_a_mirrored_board_has_its_v_the_other_way(tmp_path):
    usual, mirrored = (
        load(tmp_path, GOOD.replace("s_mm = 30.0", f"s_mm = 30.0\nyaw_deg = 5.0{extra}", 1))
        for extra in ("", "\nmirrored = true")
    )
    uv, other = usual.patches[0].patch.tactels_uv, mirrored.patches[0].patch.tactels_uv
    np.testing.assert_array_equal(other, uv * (1.0, -1.0))
    here = usual.tactels_of(0)
    swap = [np.flatnonzero((uv == place * (1.0, -1.0)).all(axis=1))[0] for place in uv]
    np.testing.assert_allclose(mirrored.tactel_s[here], usual.tactel_s[here][swap], atol=1e-12)
    assert mirrored.patches[1].patch.tactels_uv is not other
