"""The LSS master against our LSS slave: every node gets the node-ID it is to have, and no other."""

import pytest

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.frame import Frame
from skinbus.errors import BusError
from skinbus.master.commissioning.node_id_assignment import Address, Assigned, Assigner, Known
from skinbus.node import Device
from skinbus.objects import cia
from skinbus.objects.eds import load_eds
from tests.bus.cores import Repeater
from tests.master.commission import Bench, patch
from tests.master.misbehaving import Late, Wrapped
from tests.master.misbehaving_rig import OTHER_SYNC

UNCONFIGURED = 255
VENDOR, PRODUCT, REVISION = 0x534B4E42, 0x5001, 0x10000
SERIALS = [0x80000001, 7, 0xFFFFFFFF, 1, 0x0F0F0F0F]


def address(serial, product=PRODUCT):
    return Address(VENDOR, product, REVISION, serial)


def assigned(*devices, **settings):
    """Let node-IDs be assigned; return the core that did."""
    core = Assigner(**settings)
    Bench(*devices).run(core)
    return core


def test_fastscan_gives_node_ids_in_order_of_identity():
    devices = {serial: patch(UNCONFIGURED, serial=serial) for serial in SERIALS}
    core = assigned(*devices.values(), free=range(10, 20))
    assert [r.outcome for r in core.results] == [Assigned.ASSIGNED] * 5
    assert {serial: device.node_id for serial, device in devices.items()} == dict(
        zip(sorted(SERIALS), range(10, 15), strict=True)
    )
    assert {r.address.serial: r.node_id for r in core.results} == {s: d.node_id for s, d in devices.items()}
    assert {device.nmt_state for device in devices.values()} == {cia.NmtState.PRE_OPERATIONAL}


def test_node_ids_in_use_are_left_out():
    devices = [patch(UNCONFIGURED, serial=1), patch(UNCONFIGURED, serial=2)]
    assigned(patch(1), patch(3), *devices, free=range(1, 127))
    assert [device.node_id for device in devices] == [2, 4]


def test_known_serial_numbers_get_their_node_ids_whatever_they_have():
    devices = [patch(UNCONFIGURED, serial=11), patch(5, serial=12), patch(7, serial=13)]
    known = [Known(address(11), 1), Known(address(12), 2), Known(address(13), 7)]
    core = assigned(*devices, known=known)
    assert [device.node_id for device in devices] == [1, 2, 7]
    outcomes = {r.address.serial: (r.outcome, r.old) for r in core.results}
    assert outcomes == {
        11: (Assigned.ASSIGNED, UNCONFIGURED),
        12: (Assigned.ASSIGNED, 5),
        13: (Assigned.SAME, 7),
    }


def test_two_nodes_swap_their_node_ids():
    devices = [patch(1, serial=11), patch(2, serial=12)]
    core = assigned(*devices, known=[Known(address(11), 2), Known(address(12), 1)])
    assert [device.node_id for device in devices] == [2, 1]
    assert [r.outcome for r in core.results] == [Assigned.ASSIGNED] * 2


ASK_NODE_ID = b"\x5e".ljust(8, b"\0")
REFUSAL = b"\x11\x01".ljust(8, b"\0")


def replaced(frame, begin, data):
    return frame._replace(data=data) if frame.data[:1] == begin else frame


class Locked(Wrapped):
    """It answers "out of range" to every node-ID; as one whose memory is locked does."""

    def step(self, now_ns, frames):
        # in place of being given a node-ID it is asked for its own: it answers both in one mode only
        asked = [replaced(f, b"\x11", ASK_NODE_ID) if f.can_id == cia.LSS_MASTER_ID else f for f in frames]
        step = self.device.step(now_ns, asked)
        if asked == list(frames):
            return step
        return step._replace(frames=[replaced(f, ASK_NODE_ID[:1], REFUSAL) for f in step.frames])


@pytest.mark.parametrize(
    ("wanted", "locked", "after", "said"),
    [
        ((2, 3, 4), 13, [1, 2, 3], "taken by another node"),  # who would get the node-ID of 13 keeps the own
        ((2, 3, 1), 11, [1, 2, 3], "taken by another node"),
        ((2, 3, 1), 12, [2, 2, 1], "two nodes have node-ID 2 now"),
    ],
)
def test_a_node_that_does_not_move_stops_those_behind_it_or_is_named(wanted, locked, after, said):
    storages = {serial: {} for serial in (11, 12, 13)}
    devices = {serial: patch(serial - 10, storage=storages[serial], serial=serial) for serial in storages}
    known = [Known(address(serial), node_id) for serial, node_id in zip(devices, wanted, strict=True)]
    core = Assigner(known=known, free=range(1, 10))
    fresh = patch(UNCONFIGURED, serial=5)
    Bench(*(Locked(d) if serial == locked else d for serial, d in devices.items()), fresh).run(core)
    assert [device.node_id for device in devices.values()] == after
    for result in core.results:
        device = devices.get(result.address.serial, fresh)
        assert (result.outcome is Assigned.ASSIGNED) == (device.node_id == result.node_id)
    assert said in " ".join(result.reason for result in core.results)
    assert fresh.node_id not in {*after, *wanted}
    for (serial, storage), node_id in zip(
        storages.items(), after, strict=True
    ):  # and with the power off and on
        od = load_eds("skin-patch", serial - 10, serial=serial)
        assert Device(od, serial - 10, storage=storage).node_id == node_id


def test_node_that_was_left_operational_is_reached():
    device = patch(4, serial=11)
    bench = Bench(device)
    device.command(cia.NmtCommand.START)
    core = Assigner(known=[Known(address(11), 9)])
    bench.run(core)
    assert device.node_id == 9


def test_node_id_of_a_stranger_is_not_given_again():
    device, stranger = patch(UNCONFIGURED, serial=11), patch(2, serial=99)
    core = assigned(device, stranger, known=[Known(address(11), 2)])
    (result,) = core.results
    assert result.outcome is Assigned.REFUSED
    assert "taken" in result.reason
    assert (device.node_id, stranger.node_id) == (UNCONFIGURED, 2)


def reset(bench, *devices):
    """Reset those that have a node-ID: what LSS gave them comes into use; others have used it at once."""
    for device in devices:
        if device.node_id != UNCONFIGURED:
            device.command(cia.NmtCommand.RESET_COMMUNICATION)
    bench.pass_ms(10)


CONFIGURE = b"\x11"


@pytest.mark.parametrize("node_ids", [(5, 7), (5, 5), (5, UNCONFIGURED), (UNCONFIGURED, UNCONFIGURED)])
def test_known_nodes_with_one_identity_keep_what_they_have_after_a_reset_too(node_ids):
    devices = [patch(node_id, serial=1) for node_id in node_ids]
    core = Assigner(known=[Known(address(1), 9)])
    bench = Bench(devices[0], Late(devices[1]))
    bench.run(core)
    assert [r.outcome for r in core.results] == [Assigned.REFUSED]
    assert (
        "2 nodes have this identity, serial number and all; connect one at a time" in core.results[0].reason
    )
    assert str(list(node_ids)) in core.results[0].reason
    reset(bench, *devices)
    assert tuple(device.node_id for device in devices) == node_ids


@pytest.mark.parametrize("node_id", [5, UNCONFIGURED])
def test_node_whose_answer_to_its_node_id_is_lost_has_what_it_had_when_it_was_switched_off_and_on(node_id):
    storage = {}

    class Mute(Wrapped):
        """Does what it is told; its first answer to a node-ID is lost."""

        n_lost = 0

        def step(self, now_ns, frames):
            step = self.device.step(now_ns, frames)
            out = [f for f in step.frames if f.data[:1] != CONFIGURE or self.n_lost]
            self.n_lost += len(step.frames) - len(out)
            return step._replace(frames=out)

    mute = Mute(patch(node_id, storage=storage, serial=1))
    core = Assigner(known=[Known(address(1), 9)] if node_id == 5 else [], free=[9])
    bench = Bench(mute)
    bench.run(core)
    assert core.results[0].outcome is Assigned.REFUSED
    assert core.results[0].reason.startswith("did not answer when it was given a node-ID")
    assert core.results[0].reason.endswith("switch it off and on")
    assert Device(load_eds("skin-patch", 1, serial=1), node_id, storage=storage).node_id == node_id


def test_more_nodes_than_node_ids_is_said():
    devices = [patch(UNCONFIGURED, serial=serial) for serial in (1, 2)]
    core = assigned(*devices, free=[1])
    assert core.is_over_full
    assert sorted(device.node_id for device in devices) == [1, UNCONFIGURED]


def test_node_that_cannot_store_has_its_node_id_until_it_is_switched_off():
    device = Device(load_eds("skin-patch", 1, serial=3), UNCONFIGURED)
    core = assigned(device, free=[8])
    (result,) = core.results
    assert (result.outcome, device.node_id) == (Assigned.NOT_STORED, 8)
    assert "cannot store" in result.reason


def test_nothing_is_changed_while_a_master_is_at_work():
    device = patch(UNCONFIGURED, serial=1)
    bench = Bench(device, Repeater(OTHER_SYNC, 20_000_000))
    core = Assigner(free=[1])
    bench.run(core)
    with pytest.raises(BusError, match="a master is at work"):
        core.scanner.other_master.refuse("the bus")
    assert device.node_id == UNCONFIGURED


class Parrot(Core):
    """Answers fastscan always, whatever it has been given; like devices that forget to check."""

    cob_ids = frozenset({cia.LSS_MASTER_ID})

    def step(self, now_ns, frames):
        replies = {0x51: 0x4F, 0x11: 0x11, 0x17: 0x17}
        out = [
            Frame(cia.LSS_SLAVE_ID, bytes([replies[f.data[0]]]) + bytes(7))
            for f in frames
            if f.data and f.data[0] in replies
        ]
        return Step(out, (), NEVER)


def test_slave_that_never_stops_answering_does_not_hold_the_master():
    core = assigned(Parrot(), free=range(1, 127))
    assert [r.outcome for r in core.results] == [Assigned.NOT_SEEN, Assigned.REFUSED]
    assert "though it has" in core.results[1].reason
