"""``[guard]`` of an arm file: regions become tactels with limits in SI units, faults come with their keys."""

import math

import numpy as np
import pytest

from skinbus.config.arm_file import read_arm_file
from skinbus.config.system import load_arm, ods_of
from skinbus.model.law import DEFAULT_LAW
from skinbus.objects.guard import liveness_pdo
from tests.files import faults_of, put

ARM = """
[arm]
name = "guarded"
[[bus]]
name = "upper"
[[bus]]
name = "lower"
[[link]]
name = "tube"
surface = "cylinder"
length_mm = 300
radius_mm = 50
[[link]]
name = "table"
surface = "plane"
length_mm = 100
width_mm = 200
[[ring]]
link = "tube"
s_mm = 50
count = 6
first_node_id = 1
bus = "upper"
[[patch]]
node_id = 1
link = "table"
s_mm = 50
a_mm = 60
bus = "lower"
set = { "Healthy tactels" = 0xFFFE }
"""
BOARD = """
[[patch]]
node_id = 9
link = "tube"
s_mm = {}
bus = "upper"
"""
GUARD = """
[guard]
liveness_ms = 10
samples = [2, 3]
transient_ms = 250
reaction_ms = 1.5
stop_ms = 120
"""
REGION = """
[[guard.region]]
name = "{}"
source = "a test"
"""


def load(tmp_path, text):
    return load_arm(put(tmp_path, "arm.toml", ARM + GUARD + text))


def region(name, keys):
    return REGION.format(name) + keys


def faults(tmp_path, text):
    return faults_of(load, tmp_path, text)


def test_the_guard_is_read_in_si_units(tmp_path):
    keys = "force_n = 100\npressure_kpa = 50\ntransient_factor = 2"
    guard = load(tmp_path, region("all", keys)).guard
    assert (guard.n, guard.m, guard.liveness_ns) == (2, 3, 10_000_000)
    assert (guard.transient_ns, guard.reaction_ns, guard.stop_ns) == (250_000_000, 1_500_000, 120_000_000)
    (whole,) = guard.regions
    assert (whole.name, whole.source, whole.force, whole.pressure) == ("all", "a test", 100.0, 50e3)
    assert whole.transient_factor == 2.0
    assert whole.tactels.all()


@pytest.mark.parametrize(
    ("keys", "inside"),
    [
        ('link = "tube"', lambda arm: arm.tactel_link == 0),
        ('link = "tube"\ns_mm = [0, 50]', lambda arm: (arm.tactel_link == 0) & (arm.tactel_s <= 0.05)),
        (
            'link = "tube"\nangle_deg = [150, 210]',
            lambda arm: (arm.tactel_link == 0) & (abs(arm.tactel_a) >= math.radians(150) * 0.05),
        ),
        (
            'link = "tube"\nangle_deg = [-30, 30]',
            lambda arm: (arm.tactel_link == 0) & (abs(arm.tactel_a) <= math.radians(30) * 0.05),
        ),
        ('link = "table"\na_mm = [60, 90]', lambda arm: (arm.tactel_link == 1) & (arm.tactel_a >= 0.06)),
        ("patches = [1, 3]", lambda arm: np.isin(arm.node_id, [1, 3])[arm.tactel_patch]),
        ('link = "table"\npatches = [1]', lambda arm: arm.tactel_link == 1),
    ],
)
def test_a_region_is_what_is_in_all_that_is_said(tmp_path, keys, inside):
    arm = load(tmp_path, region("here", f"force_n = 50\n{keys}"))
    (here,) = arm.guard.regions
    np.testing.assert_array_equal(here.tactels, inside(arm))
    assert 0 < here.tactels.sum() < arm.n_tactels
    assert here.pressure == math.inf


def test_tactels_on_the_edge_of_a_region_are_in_it(tmp_path):
    """0.199 + 0.015 is more than 0.214."""
    keys = "force_n = 5\npatches = [9]\ns_mm = [184, 214]"
    assert load(tmp_path, region("here", keys) + BOARD.format(199)).guard.tactels.sum() == 16


@pytest.mark.parametrize("gain", [0, -1])
def test_tactels_whose_readings_do_not_rise_are_refused(tmp_path, gain):
    board = BOARD.format(200) + f'set."Tactel gain" = {[gain] + [1] * 15}'
    (fault,) = faults(tmp_path, region("all", "force_n = 5") + board)
    assert fault.startswith("guard.region[1]: is 'a tactel whose gain is not positive'")


def test_the_guard_stays_with_an_arm_that_is_changed(tmp_path):
    arm = load(tmp_path, region("all", 'force_n = 50\nlink = "table"'))
    assert arm.with_rate(10.0).guard is arm.guard
    assert arm.with_law(DEFAULT_LAW).guard is arm.guard
    upper, lower = (arm.part(bus).guard.regions[0].tactels for bus in (0, 1))
    assert (len(upper), upper.sum(), len(lower), lower.sum()) == (96, 0, 16, 16)


def test_faults_of_all_regions_are_said_at_once(tmp_path):
    text = "".join(
        [
            region("neither", ""),
            region("link", 'force_n = 5\nlink = "tub"'),
            region("patch", "force_n = 5\npatches = [2, 99]"),
            region("patch", "force_n = 5"),
        ]
    )
    assert faults(tmp_path, text) == [
        "guard.region[4].name: is 'patch'; wanted another: guard.region[3] has it",
        "guard.region[1]: wanted force_n or pressure_kpa, or both",
        "guard.region[2].link: is 'tub'; wanted the name of a link: tube, table",
        "guard.region[3].patches: is [99]; wanted node-IDs of patches",
    ]


def test_values_are_checked_with_the_rest_of_the_file(tmp_path):
    path = put(
        tmp_path,
        "arm.toml",
        ARM
        + "[guard]\nliveness_ms = 0\nsamples = [3, 2]\n[[guard.region]]\nname = 'a'\nforce_n = -1\n"
        + "s_mm = [5, 4]\ntransient_factor = 0.5\nforce = 5\n",
    )
    wanted = {fault.key: fault.wanted for fault in read_arm_file(path).faults}
    region_keys = {
        f"guard.region[1].{key}" for key in ("force_n", "s_mm", "transient_factor", "source", "force")
    }
    assert {*wanted} == {"guard.liveness_ms", "guard.samples", *region_keys}
    assert wanted["guard.region[1].force"] == "no such key; did you mean 'force_n'?"


def test_a_guard_without_regions_is_refused(tmp_path):
    assert faults(tmp_path, "") == ["guard.region: wanted a value; it has no default"]


def test_limits_that_no_reading_exceeds_are_refused(tmp_path):
    """The usual board states 250 kPa on 25 cm2."""
    text = region("low", "patches = [2]\npressure_kpa = 124\ntransient_factor = 2\nforce_n = 312")
    assert load(tmp_path, text).guard
    text = region("high", "pressure_kpa = 126\ntransient_factor = 2\npatches = [2]\nforce_n = 313")
    assert faults(tmp_path, text) == [
        "guard.region[1].force_n: is 313.0; wanted at most 312.5: full scale over transient_factor",
        "guard.region[1].pressure_kpa: is 126.0; wanted at most 125: full scale over transient_factor",
    ]


def test_a_region_without_a_healthy_tactel_is_refused(tmp_path):
    text = region("gap", 'force_n = 5\nlink = "tube"\ns_mm = [200, 210]')
    # tactel 1 of the board on the table is declared dead
    text += region("dead", 'force_n = 5\nlink = "table"\ns_mm = [30, 40]\na_mm = [40, 46]')
    text += region("flat", 'force_n = 5\nlink = "table"\nangle_deg = [-180, 180]')
    assert [text.split(":")[0] for text in faults(tmp_path, text)] == [
        "guard.region[1]",
        "guard.region[2]",
        "guard.region[3]",
    ]


def test_boards_in_a_region_send_the_state_of_their_guard(tmp_path):
    arm = load(tmp_path, region("table", 'force_n = 5\nlink = "table"'))
    assert arm.guarded.tolist() == [False] * 6 + [True]
    pdos = [liveness_pdo(od) for od in ods_of(arm)]
    assert [(pdo.valid, pdo.event_timer_ms) for pdo in pdos] == [(False, 0)] * 6 + [(True, 10)]


def test_a_board_whose_state_has_no_identifier_is_refused(tmp_path):
    """The board of 64 tactels has them up to node-ID 47."""
    board = '[[patch]]\nnode_id = {}\nlink = "tube"\ns_mm = 250\nbus = "upper"\neds = "skin-patch-8x8"\n'
    assert load(tmp_path, region("all", "force_n = 5\n") + board.format(47)).guarded.all()
    (fault,) = faults(tmp_path, region("all", "force_n = 5\n") + board.format(48))
    assert fault == (
        "patch[2]: is 'COB-ID 0x6E0'; wanted a TPDO for 'Guard/State', up to 0x6DF: another node-ID or board"
    )
    assert not load(tmp_path, region("one", "force_n = 5\npatches = [2]\n") + board.format(48)).guarded.all()
