"""When a bus has recovered, readings are fresh again within a second, and none is that was sampled before."""

from functools import partial

import pytest

from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from tests.bus.cores import Repeater
from tests.master.full_queue import FullQueue
from tests.master.misbehaving_rig import booted
from tests.master.rig import MS

pytestmark = pytest.mark.slow

BACK_MS = 1000


def assert_back(rig):
    """All patches are fresh within the bound, and from then on in every cycle."""
    assert any(cycle.fresh.all() for cycle in rig.run(BACK_MS)[0]), "not fresh"
    assert rig.fresh(2000).min() == 1.0
    assert not rig.violations


@pytest.mark.parametrize(
    ("room", "stuck_ms", "reports"),
    [
        *((10, 300, True), (0, 70, True), (200, 6000, True)),
        *((10, 70, False), (0, 6000, False), (200, 300, False)),
    ],
)
def test_after_syncs_that_a_full_queue_discarded_or_sent_late(room, stuck_ms, reports):
    rig = booted("pad")
    queue = FullQueue(rig.master, room, reports=reports)
    rig.run(stuck_ms)
    queue.is_stuck = False
    assert_back(rig)


def answers_from(now, begins_ns, node_id, tpdo):
    """Half of the patches answer at once, the others later."""
    return 0 if node_id % 2 or now() >= begins_ns else None


@pytest.mark.parametrize(("times", "absent_ms"), [(1, 0), (1, 250), (3, 130)])
def test_after_an_interface_that_went_and_patches_that_come_back_later(absent_ms, times):
    rig = booted("forearm")
    for _ in range(times):
        say(rig, EventKind.BUS_LOST)
        rig.patches.delay = lambda node_id, tpdo: None
        rig.run(400)
        say(rig, EventKind.BUS_BACK)
        begins_ns = rig.wire.clock.now_ns() + absent_ms * MS
        rig.patches.delay = partial(answers_from, rig.wire.clock.now_ns, begins_ns)
        rig.run(absent_ms + 60)
    assert_back(rig)


@pytest.mark.parametrize("phase_ms", [0, 9, 17])
def test_after_a_node_that_babbled_under_the_identifier_of_a_patch(phase_ms):
    rig = booted("pad")
    rig.run(20 + phase_ms)
    now_ns = rig.wire.clock.now_ns()
    babble = Frame(0x181, bytes([0xFF] * 8))
    rig.wire.attach(Repeater(babble, MS // 3, end_ns=now_ns + 700 * MS))
    assert rig.fresh(700).max() == 0.0
    assert_back(rig)


def say(rig, kind):
    now_ns = rig.wire.clock.now_ns()
    rig.master.bus_news(now_ns, Event(t_ns=now_ns, kind=kind))
