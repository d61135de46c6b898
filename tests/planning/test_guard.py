"""The bound of the guard: its parts by hand, its goal, and the wire in the critical instant."""

import pytest

from skinbus.config.arm_file import find_arm
from skinbus.config.system import load_arm
from skinbus.planning.guard import guard_bound
from skinbus.planning.plan import plans
from skinbus.planning.schedule import Release
from tests.cli.invoke import run
from tests.files import put

pytestmark = pytest.mark.slow

GUARD = """
[guard]
samples = [2, 3]
reaction_ms = 1.5
stop_ms = 120
[[guard.region]]
name = "all"
force_n = 50
source = "a test"
"""
FD = {
    "[arm]\n": "[arm]\ncanfd = true\ndata_bitrate = 2_000_000\n",
    "first_node_id": 'eds = "skin-patch-fd"\nfirst_node_id',
}


def guarded(tmp_path, name, guard=GUARD, changes=()):
    """The file of a shipped arm with a guard, and with other words."""
    text = find_arm(name).read_text() + guard
    for old, new in dict(changes).items():
        text = text.replace(old, new)
    return put(tmp_path, "arm.toml", text)


def bounds(path, **settings):
    arm = load_arm(path)
    found = plans(arm, {"fit": 500_000}, level="fit", **settings)
    return [guard_bound(plan, arm.guard) for plan in found]


def test_parts_are_those_of_the_arm_file_and_of_the_longest_frames(tmp_path):
    """By hand at 1 Mbit/s: GFC has 55 bits at most, 8 bytes 135, NMT 75, an error frame 31."""
    (bound,) = bounds(guarded(tmp_path, "pad"), response_ns=40_000)
    us = {part.name: part.ns / 1000 for part in bound.parts}
    assert us == {
        "next sample": 1000,
        "more samples": 1000,
        "comparison": 40,
        "GFC": 55,
        "frame under way": 135,
        "NMT": 75,
        "bit error": 31 + 75,
    }
    assert bound.frame_ns == 2_411_000
    assert bound.standstill_ns == 2_411_000 + 121_500_000
    (slow,) = bounds(guarded(tmp_path, "pad"), bitrate=125_000)
    assert slow.frame_ns == 2_000_000 + 8 * 371_000


@pytest.mark.parametrize(
    ("name", "changes", "n"),
    [("forearm", {}, 1), ("forearm", FD, 1), ("arm", {}, 1), ("arm-two-buses", {}, 2)],
)
def test_the_goal_of_two_milliseconds_is_kept(tmp_path, name, changes, n):
    at_once = GUARD.replace("[2, 3]", "[1, 1]")
    found = bounds(guarded(tmp_path, name, at_once, changes), response_ns=100_000)
    assert len(found) == n
    assert all(bound.frame_ns < 2_000_000 for bound in found)
    under_way = {part.name: part.ns for bound in found for part in bound.parts}["frame under way"]
    assert (under_way > 135_000) == bool(changes)  # a frame of 8 bytes, or one of 48 on CAN FD


def test_a_bus_without_limits_has_no_bound(tmp_path):
    upper, lower = bounds(guarded(tmp_path, "arm-two-buses", GUARD + 'link = "forearm"\n'))
    assert (upper is None) != (lower is None)


def test_the_state_of_a_guard_is_part_of_the_traffic(tmp_path):
    (plan,) = plans(load_arm(guarded(tmp_path, "pad")), {"fit": 500_000}, level="fit")
    (state,) = [m for m in plan.traffic.messages if m.name.endswith("TPDO 9")]
    assert (state.period_ns, state.bits, state.release) == (50_000_000, 75, Release.SPORADIC)
    assert not plan.traffic.unpaced


def test_the_command_says_what_is_assumed(tmp_path):
    some = guarded(tmp_path, "arm-two-buses", GUARD + "patches = [1]\n")
    said = run("plan", str(some), "--compute-us", "500")
    assert "from a limit to GFC on the wire" in said
    assert "from a mailbox of its own" in said
    assert "not guarded" in said
