"""What the master makes of batches, of faults of the bus, and of commands from others; on virtual time."""

import pytest

from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.objects import cia
from skinbus.objects.cia import EmcyCode
from tests.master.faults_rig import emcy
from tests.master.rig import MS, Rig


@pytest.fixture
def rig():
    rig = Rig("pad")
    rig.run(1000)
    return rig


def now(rig):
    return rig.wire.clock.now_ns()


def news(rig, kind, count=0):
    rig.master.bus_news(now(rig), Event(t_ns=now(rig), kind=kind, count=count))


def reset_frame(command):
    return Frame(0x000, bytes([command, 127]))


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
    assert [told for told, _ in emcy([*first, *then])] == [code, EmcyCode.NO_ERROR]


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


def test_a_babbling_node_is_reported_with_its_identifier_until_it_ends_or_the_bus_goes(rig):
    def babble(kind, can_id):
        rig.master.bus_news(now(rig), Event(t_ns=now(rig), kind=kind, cob_id=can_id, count=5000))
        return [frame.data for frame in rig.run(50)[2] if frame.can_id == 0x0FF]

    (first,) = babble(EventKind.BABBLING, 0x333)
    assert first == bytes([0x00, 0x81, 0x11, 0x33, 0x03, 0, 0, 0])
    assert babble(EventKind.BABBLING_END, 0x444) == []
    (end,) = babble(EventKind.BABBLING_END, 0x333)
    assert end[:5] == bytes([0, 0, 0, 0x00, 0x81])
    babble(EventKind.BABBLING, 0x333)
    news(rig, EventKind.BUS_LOST)
    assert not rig.master.device.get(0x1001, 0)
