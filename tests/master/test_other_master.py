"""Another master on the bus: told when it comes, told when it is gone, and no end of the cycles."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from skinbus.can.event import EventKind
from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.system import load_arm
from skinbus.master import Master
from skinbus.master.other_master import GONE_NS
from skinbus.objects.cia import EmcyCode
from tests.bus.cores import Repeater
from tests.master.commission import Bench, patch
from tests.master.faults_rig import emcy
from tests.master.misbehaving_rig import OTHER_SYNC
from tests.master.rig import MS, Rig

pytestmark = pytest.mark.slow

SYNC = 0x080
ARM = load_arm("pad")


def told(events):
    """What events say of another master."""
    return [event.kind for event in events if event.kind.startswith("other-master")]


def test_another_master_is_reported_once_when_it_comes_and_once_when_it_is_gone():
    rig = Rig("pad")
    rig.run(1000)
    assert not told(rig.events)
    begin_ns = rig.wire.now_ns + 3 * MS
    rig.wire.attach(Repeater(OTHER_SYNC, 17 * MS, begin_ns, begin_ns + 500 * MS))
    reports, events, frames = rig.run(500)
    assert told(events) == [EventKind.OTHER_MASTER]
    assert (EmcyCode.COMMUNICATION, SYNC) in emcy(frames)
    assert len(reports) >= 45
    reports, events, frames = rig.run(100 + GONE_NS / MS)
    assert told(events) == [EventKind.OTHER_MASTER_END]
    assert rig.master.device.get(0x1001, 0) == 0
    assert reports[-1].n_fresh == 1


def reset_of_all(frames):
    return [f for f in frames if (f.can_id, f.data) == (0x000, b"\x82\x00")]


STARTS = st.integers(0, 4 * 65).map(lambda k: k * 500) | st.integers(0, 130_000) | st.integers(0, 3_000_000)
NUMBERS = st.integers(0, 0xFFFF_FFFF)


@settings(max_examples=12, deadline=None)
@given(
    STARTS, st.lists(NUMBERS, min_size=2, max_size=3, unique=True), st.booleans(), st.sampled_from([127, 126])
)
@example(0, [0, 0x10000], True, 127)
@example(0, [1, 0], False, 127)
@example(100_000, [0, 1], False, 127)
@example(100_000, [0, 1], True, 127)
@example(65_535, [0xFFFF, 0], True, 126)
def test_of_masters_that_start_together_one_runs(later_us, numbers, has_patch, other_node_id):
    bench = Bench(*[patch(1)] * has_patch)
    masters, stopped, reports = [], [], []
    for k, number in enumerate(numbers):
        reports.append([])
        node_id = other_node_id if k == 1 else 127
        masters.append(
            Master(ARM, number=number, node_id=node_id, level="kmeans", on_cycle=reports[k].append)
        )
        bench.wire.attach(masters[k], on_event=stopped.append)
        bench.pass_ms(later_us / 1e3)
    bench.pass_ms(300)
    (winner,) = [k for k, master in enumerate(masters) if not master.gave_way]
    assert [e.kind for e in stopped if e.kind in (EventKind.OTHER_MASTER, EventKind.STOP)] == [
        EventKind.OTHER_MASTER,
        EventKind.STOP,
    ] * (len(masters) - 1)
    assert len(reset_of_all(bench.frames)) <= 1
    bench.frames.clear()
    begun = [len(own) for own in reports]
    bench.pass_ms(300)
    grown = [len(own) - n for own, n in zip(reports, begun, strict=True)]
    assert [n > 0 for n in grown] == [k == winner for k in range(len(masters))]
    assert reports[winner][-1].n_fresh == has_patch
    for k, master in enumerate(masters):
        assert (master.last_frames(bench.wire.now_ns) == []) == (k != winner)


def test_of_two_masters_that_run_when_their_buses_are_joined_one_goes_on():
    masters = [Master(ARM, number=number, level="kmeans") for number in (7, 3)]
    bench = Bench(patch(1))
    port = bench.wire.attach(masters[0])
    apart = VirtualBus()
    apart.attach(masters[1])
    apart.run(2000 * MS)
    bench.pass_ms(2000)
    bench.wire.attach(masters[1])
    bench.pass_ms(1000)
    assert [bool(master.gave_way) for master in masters] == [True, False]
    assert "node-ID 127" in str(masters[0].gave_way)
    assert port.core.last_frames(bench.wire.now_ns) == []


def test_a_master_answers_no_reset_of_another_by_a_broadcast():
    bench = Bench(patch(1))
    bench.wire.attach(Master(ARM, number=7))
    bench.pass_ms(1000)
    bench.frames.clear()
    bench.wire.attach(Master(ARM))  # it makes no claims, and does not listen
    bench.pass_ms(2000)
    assert len(reset_of_all(bench.frames)) == 1
