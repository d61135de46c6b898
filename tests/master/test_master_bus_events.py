"""What the master makes of batches, of faults of the bus, and of commands from others; on virtual time."""

from dataclasses import replace

import numpy as np
import pytest

from skinbus.can.core import Core
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame, FrameBatch
from skinbus.node.emcy import RETRY_NS as EMCY_RETRY_NS
from skinbus.objects import cia
from skinbus.objects.cia import EmcyCode
from tests.master.rig import MS, Rig
from tests.packing import pack


@pytest.fixture
def rig():
    rig = Rig("pad")
    rig.run(1000)
    return rig


def now(rig):
    return rig.wire.clock.now_ns()


def news(rig, kind, count=0):
    rig.master.bus_news(now(rig), Event(t_ns=now(rig), kind=kind, count=count))


def emcy_codes(frames):
    return [int.from_bytes(frame.data[:2], "little") for frame in frames if frame.can_id == 0x0FF]


def reset_frame(command):
    return Frame(0x000, bytes([command, 127]))


def test_batch_completes_a_cycle(rig):
    while not rig.master.gather.is_open:
        rig.run(0.05)
    plan, gather = rig.master.gather.plan, rig.master.gather
    batch = FrameBatch(16)
    counts = np.arange(plan.n_tactels, dtype=np.int32) + 1
    pack(plan, counts, batch, t_ns=now(rig))
    assert rig.master.n_owed == 4
    rig.master.take(now(rig), batch)
    assert rig.master.n_owed == 0
    rig.master.step(now(rig), [])
    assert np.array_equal(gather.counts, counts)
    assert rig.reports[-1].n_fresh == 1


@pytest.mark.parametrize(
    ("comes", "goes", "code"),
    [
        (EventKind.ERROR_PASSIVE, EventKind.ERROR_PASSIVE_END, EmcyCode.CAN_PASSIVE),
        (EventKind.BUS_OFF, EventKind.BUS_OFF_END, EmcyCode.BUS_OFF_RECOVERED),
        (EventKind.BUS_LOST, EventKind.BUS_BACK, EmcyCode.BUS_OFF_RECOVERED),
        (EventKind.SEND_QUEUE_FULL, EventKind.SEND_QUEUE_FULL_END, EmcyCode.CAN_OVERRUN),
    ],
)
def test_each_fault_is_one_emcy_and_its_end_another(rig, comes, goes, code):
    news(rig, comes)
    _, _, first = rig.run(50)
    news(rig, goes)
    _, _, then = rig.run(50)
    assert emcy_codes([*first, *then]) == [code, EmcyCode.NO_ERROR]


def test_lost_bus_takes_contacts_back_and_says_so_when_it_returns(rig):
    assert rig.master.device.get(0x3001, 5) > 0
    news(rig, EventKind.BUS_LOST)
    assert rig.master.device.get(0x3001, 5) == 0
    news(rig, EventKind.BUS_BACK)
    _, _, frames = rig.run(15)
    contact = next(frame for frame in frames if frame.can_id == 0x681)
    assert contact.data == bytes(8)


def test_readings_of_a_cycle_that_was_overslept_are_not_shown(rig):
    while not rig.master.gather.is_open:
        rig.run(0.05)
    n = len(rig.reports)
    rig.master.step(now(rig) + 2000 * MS, [])
    assert len(rig.reports) == n + 1
    assert rig.reports[-1].n_fresh == 0
    assert len(rig.reports[-1].contacts) == 0


@pytest.mark.parametrize("command", [cia.NmtCommand.RESET_NODE, cia.NmtCommand.RESET_COMMUNICATION])
def test_reset_in_the_middle_of_a_cycle_begins_anew(rig, command):
    while not rig.master.gather.is_open:
        rig.run(0.05)
    rig.master.step(now(rig), [reset_frame(command)])
    rig.master.step(now(rig), [])
    rig.run(500)
    assert rig.reports[-1].n_fresh == 1


@pytest.mark.parametrize("command", [cia.NmtCommand.STOP, cia.NmtCommand.PRE_OPERATIONAL])
def test_the_master_stays_operational_whoever_commands_otherwise(rig, command):
    rig.master.step(now(rig), [reset_frame(command)])
    rig.run(50)
    assert rig.master.device.nmt_state is cia.NmtState.OPERATIONAL
    assert rig.reports[-1].t_ns > now(rig) - 25 * MS


class FullQueue(Core):
    """A queue between master and wire that swallows what it is given while ``is_full``."""

    def __init__(self, rig):
        self.is_full = True
        self._master, self._step = rig.master, rig.master.step
        rig.master.step = self.step

    def step(self, now_ns, frames):
        step = self._step(now_ns, frames)
        if not self.is_full:
            return step
        self._master.not_sent(now_ns, step.frames)
        return step._replace(frames=())


def test_emcy_that_a_full_queue_swallowed_is_reported_again_until_it_is_through(rig):
    queue = FullQueue(rig)
    news(rig, EventKind.SEND_QUEUE_FULL_END)
    _, _, frames = rig.run(1000)
    assert emcy_codes(frames) == []
    queue.is_full = False
    _, _, frames = rig.run(2 * EMCY_RETRY_NS // MS)
    # What followed from SYNC being swallowed too comes after it.
    assert emcy_codes(frames)[:2] == [EmcyCode.CAN_OVERRUN, EmcyCode.NO_ERROR]
    assert not rig.master.device.get(0x1001, 0)


def test_contacts_whose_end_a_full_queue_swallowed_are_taken_back(rig):
    assert rig.master.device.get(0x3001, 5) > 0
    rig.patches.unplugged.add(1)
    queue = FullQueue(rig)
    rig.run(5000)
    assert rig.master.device.get(0x3001, 5) == 0
    queue.is_full = False
    _, _, frames = rig.run(100)
    assert [frame for frame in frames if frame.can_id == 0x681] == []
    news(rig, EventKind.SEND_QUEUE_FULL_END)
    _, _, frames = rig.run(50)
    (contact,) = [frame for frame in frames if frame.can_id == 0x681]
    assert not any(contact.data[6:])


def test_count_too_large_for_its_object_is_shown_as_its_largest(rig):
    rig.master.level_control.overruns = 2**32 + 5
    report = replace(
        rig.reports[-1],
        contacts=range(300),
        compute_ns=10**9,
        latency_ns=10**10,
        budget_us=1e12,
    )
    rig.master.publisher.summary(report, rig.master.level_control, n_faulty=0)
    assert [rig.master.device.get(0x2100, sub) for sub in (2, 5, 6, 8)] == [255, 0xFFFF, 0xFFFF, 5]


def test_a_babbling_node_is_reported_with_identifier_and_rate_until_it_ends_or_the_bus_goes(rig):
    def babble(kind, can_id):
        rig.master.bus_news(now(rig), Event(t_ns=now(rig), kind=kind, cob_id=can_id, count=5000))
        return [frame.data for frame in rig.run(50)[2] if frame.can_id == 0x0FF]

    (first,) = babble(EventKind.BABBLING, 0x333)
    assert first == bytes([0x00, 0x81, 0x11, 0x33, 0x03, 0, 0, 50])
    assert babble(EventKind.BABBLING_END, 0x444) == []
    (end,) = babble(EventKind.BABBLING_END, 0x333)
    assert end[:5] == bytes([0, 0, 0, 0x00, 0x81])
    babble(EventKind.BABBLING, 0x333)
    news(rig, EventKind.BUS_LOST)
    assert not rig.master.device.get(0x1001, 0)
