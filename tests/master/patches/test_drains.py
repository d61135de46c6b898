"""A patch that is behind while others are not is stopped until it is silent: it alone is missing for that."""

import numpy as np
import pytest

from skinbus.can.event import EventKind
from skinbus.objects import cia
from tests.master.misbehaving_rig import MisbehavingRig

START, PRE_OPERATIONAL = b"\x01", b"\x80"

ARM = """
[arm]
name = "three"
rate_hz = 50.0

[[link]]
name = "plate"
surface = "plane"
length_mm = 180.0
width_mm = 60.0
"""
PATCH = """
[[patch]]
node_id = {}
link = "plate"
s_mm = {}
"""
SCENE = """
[scene]
arm = "arm.toml"
duration_s = 60.0
"""
MIDDLE = 2
OTHERS = [0, 2]


@pytest.fixture
def rig(tmp_path):
    (tmp_path / "arm.toml").write_text(ARM + "".join(PATCH.format(k, 60 * k - 30) for k in (1, 2, 3)))
    (tmp_path / "scene.toml").write_text(SCENE)
    rig = MisbehavingRig(tmp_path / "scene.toml")
    rig.run(3000)
    assert rig.run(200).all()
    rig.nmt = []
    rig.wire.tap(lambda frame: rig.nmt.append(frame.data[:1]) if frame.can_id == cia.NMT_COMMAND_ID else None)
    return rig


def lose_one(rig):
    lost = [2]

    def delay(node_id, tpdo):
        return None if node_id == MIDDLE and tpdo in lost and (lost.clear() or True) else 0

    rig.patches.delay = delay


def longest_ns(rig, n):
    """Longest time between the SYNCs of the cycles from the n-th on."""
    return np.diff([t_ns for t_ns, _, _ in rig.cycles[n:]]).max()


def test_a_lost_frame_costs_the_other_patches_no_cycle(rig):
    lose_one(rig)
    n = len(rig.cycles)
    share = rig.run(1000)
    assert (share[OTHERS] == 1.0).all()
    assert longest_ns(rig, n) < 1.5 * rig.period_ns, "no SYNC is left out"
    assert 0 < [bool(fresh[MIDDLE - 1]) for _, fresh, _ in rig.cycles[n:]].count(False) <= 6
    assert rig.nmt == [PRE_OPERATIONAL, START]
    assert rig.run(400).all()
    assert not rig.violations


@pytest.mark.slow
@pytest.mark.parametrize("periods", [1.05, 3.2])
def test_a_patch_that_is_late_is_tried_again_with_growing_pauses_and_never_used(rig, periods):
    rig.patches.delay = lambda node_id, tpdo: periods * rig.period_ns if node_id == MIDDLE else 0
    n = len(rig.cycles)
    share = rig.run(8000)
    assert share[MIDDLE - 1] < 0.01  # of answers that were under way when it began
    assert (share[OTHERS] == 1.0).all()
    assert longest_ns(rig, n) < 1.5 * rig.period_ns, "no SYNC is left out"
    assert 2 <= rig.nmt.count(START) <= 4
    assert EventKind.READINGS_LOST in rig.kinds(MIDDLE)
    assert EventKind.PATCH_FELL_BACK not in rig.kinds(MIDDLE)
    rig.patches.delay = lambda node_id, tpdo: 0
    rig.run(9000)
    assert rig.run(400).all()
    assert not rig.violations


def test_a_patch_that_does_not_obey_is_used_after_a_gap(rig):
    step = rig.patches.world.step

    def deaf(now_ns, frames):
        return step(now_ns, [f for f in frames if f.can_id != cia.NMT_COMMAND_ID or f.data[1] != MIDDLE])

    rig.patches.world.step = deaf
    lose_one(rig)
    n = len(rig.cycles)
    rig.run(5000)
    assert longest_ns(rig, n) > 1.5 * rig.period_ns
    assert rig.run(400).all()
    assert not rig.violations
