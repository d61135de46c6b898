"""A patch that is behind while others are not is stopped until it is silent: it alone is missing."""

import numpy as np
import pytest

from skinbus.can.event import EventKind
from skinbus.objects import cia
from tests.files import put
from tests.master.misbehaving import Tool
from tests.master.misbehaving_rig import booted

pytestmark = pytest.mark.slow

LINK = '[arm]\nname = "three"\nrate_hz = 50.0\n[[link]]\nname = "plate"\nsurface = "plane"\n'
LINK += "length_mm = 180.0\nwidth_mm = 60.0\n"
PATCH = '[[patch]]\nnode_id = {}\nlink = "plate"\ns_mm = {}\n'
SCENE = '[scene]\narm = "arm.toml"\nduration_s = 60.0\n'
MIDDLE = 2
OTHERS = [0, 2]


@pytest.fixture
def rig(tmp_path):
    put(tmp_path, "arm.toml", LINK + "".join(PATCH.format(k, 60 * k - 30) for k in (1, 2, 3)))
    return booted(put(tmp_path, "scene.toml", SCENE))


def lose_one(rig):
    lost = [(MIDDLE, 2)]
    rig.patches.delay = lambda *frame: lost.clear() if frame in lost else 0


def longest_periods(rig, n):
    """Longest time between the SYNCs of the cycles from the n-th on, in periods."""
    return np.diff([cycle.t_ns for cycle in rig.reports[n:]]).max() / rig.period_ns


def test_a_lost_frame_costs_the_other_patches_no_cycle(rig):
    lose_one(rig)
    n = len(rig.reports)
    share = rig.fresh(1000)
    assert longest_periods(rig, n) < 1.5, "no SYNC is left out"
    assert (share[OTHERS] == 1.0).all()
    assert share[MIDDLE - 1] >= 0.8, "it is missing for ten cycles at most"
    assert rig.fresh(400).all()
    assert not rig.violations


@pytest.mark.parametrize("periods", [1.05, 3.2])
def test_a_patch_that_is_late_is_tried_again_with_growing_pauses_and_never_used(rig, periods):
    rig.patches.delay = lambda node_id, tpdo: periods * rig.period_ns if node_id == MIDDLE else 0
    n = len(rig.reports)
    share = rig.fresh(8000)
    assert share[MIDDLE - 1] < 0.01  # of answers that were under way when it began
    assert longest_periods(rig, n) < 1.5, "no SYNC is left out"
    assert (share[OTHERS] == 1.0).all()
    assert 2 <= rig.kinds(MIDDLE).count(EventKind.PATCH_STARTED) <= 4
    assert EventKind.READINGS_LOST in rig.kinds(MIDDLE)
    rig.patches.delay = lambda node_id, tpdo: 0
    rig.run(9000)
    assert rig.fresh(400).all()
    assert not rig.violations


def test_a_patch_that_does_not_obey_is_used_after_a_gap(rig):
    step = rig.patches.device.step
    rig.patches.device.step = lambda now_ns, frames: step(
        now_ns, [f for f in frames if f.can_id != cia.NMT_COMMAND_ID or f.data[1] != MIDDLE]
    )
    lose_one(rig)
    n = len(rig.reports)
    rig.run(5000)
    assert longest_periods(rig, n) > 1.5
    assert rig.fresh(400).all()
    assert not rig.violations


def test_a_late_patch_that_goes_on_while_it_is_booted_again_is_not_used(rig):
    rig.patches.delay = lambda node_id, tpdo: 3.2 * rig.period_ns if node_id == MIDDLE else 0
    rig.run(400)
    rig.wire.attach(Tool(MIDDLE, [(cia.HEARTBEAT_PRODUCER, 0, b"\xf4\x01")]))
    rig.run(4000)
    assert EventKind.PATCH_FELL_BACK in rig.kinds(MIDDLE)
    assert not rig.violations
