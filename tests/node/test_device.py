"""The device as its host sees it: values and views, memory, hooks, events, timers."""

from pathlib import Path

import pytest

from skinbus.can.core import NEVER
from skinbus.can.event import EventKind
from skinbus.can.frame import EXTENDED, LONG, RTR, Frame
from skinbus.node import Device
from skinbus.objects.cia import AbortCode, NmtState
from skinbus.objects.eds import build_od, load_eds
from skinbus.objects.eds_file import read_text
from tests.node.node_table import Bench

START = Frame(0, b"\x01\x00")
SYNC = Frame(0x80)


ODD = Path(__file__).parent / "odd.eds"
"""A small dictionary whose PDOs are not whole bytes: boolean, byte, boolean, 16 bits."""


def odd_od():
    return build_od(read_text(ODD.read_text(), name=ODD.name), 3)


def test_first_step_boots_and_says_when_to_call_again():
    device = Device(load_eds("skin-patch", 5), 5)
    assert device.nmt_state is NmtState.INITIALISING
    step = device.step(1_000)
    assert step.frames == [Frame(0x705, b"\0", 1_000)]
    assert device.nmt_state is NmtState.PRE_OPERATIONAL
    assert step.wake_ns == 1_000 + 500_000_000  # the heartbeat of its EDS


@pytest.mark.parametrize("node_id", [0, 128, 254, -1])
def test_node_id_that_is_none_is_refused(node_id):
    with pytest.raises(ValueError, match="node_id"):
        Device(load_eds("skin-patch", 5), node_id)


def test_dictionary_without_the_mandatory_objects_is_refused():
    od = load_eds("skin-patch", 5)
    del od[0x1001], od[0x1018]
    with pytest.raises(ValueError, match="0x1001, 0x1018"):
        Device(od, 5)


def test_what_the_host_sets_before_the_boot_holds_until_a_reset():
    device = Device(load_eds("skin-patch", 5), 5)
    device.set(0x1017, 0, 40)
    device.set(0x1018, 4, 77)
    assert device.step(0).wake_ns == 40_000_000
    device.step(1, [Frame(0, b"\x81\x05")])
    assert (device.get(0x1017), device.get(0x1018, 4)) == (500, 77)


def test_node_that_loses_its_node_id_falls_silent():
    device = Device(load_eds("skin-patch", 5), 5)
    device.step(0)
    for data in (b"\x04\x01", b"\x11\xff"):
        device.step(0, [Frame(0x7E5, data.ljust(8, b"\0"))])
    step = device.step(0, [Frame(0, b"\x82\x05")])
    assert (step.frames, step.wake_ns) == ([], NEVER)
    device.set(0x1017, 0, 10)
    assert device.step(10**9).frames == []
    assert device.cob_ids == {0x7E5}


def test_pdo_that_is_not_whole_bytes():
    device = Device(odd_od(), 3)
    device.step(0)
    device.step(0, [START])
    assert device.get(0x2003) == -5  # written 0xFFFB in the file
    device.set(0x2000, 0, True)
    device.set(0x2001, 0, True)
    device.set(0x2002, 0, 0xA5)
    device.transmit_tpdo(1)
    frame = device.step(0).frames[0]
    # bit 0 left, bits 1-8 level, bit 9 right, bits 10-25 angle
    assert int.from_bytes(frame.data, "little") == 1 | 0xA5 << 1 | 1 << 9 | 0xFFFB << 10
    device.step(0, [Frame(0x203, (0x3C << 1 | 0x1234 << 10).to_bytes(4, "little"))])
    assert [device.get(index) for index in (0x2000, 0x2001, 0x2002, 0x2003)] == [False, False, 0x3C, 0x1234]


def test_number_of_watched_nodes_is_not_written_whatever_an_eds_says():
    device = Device(odd_od(), 3)
    device.step(0)
    (answer,) = device.step(0, [Frame(0x603, bytes.fromhex("2F16100002000000"))]).frames
    assert answer.data == bytes.fromhex("8016100002000106")


def test_pdo_of_a_board_for_can_fd_is_padded_to_a_length_of_can_fd():
    device = Device(load_eds("skin-patch-fd", 5), 5)
    device.step(0, [])
    device.step(0, [START])
    device.image_view(0x6401, 1, 16)[:] = range(1, 17)
    (frame,) = device.step(1, [SYNC]).frames
    assert (frame.can_id, frame.flags) == (0x185, LONG)
    readings = b"".join(n.to_bytes(2, "little") for n in range(1, 17))
    assert frame.data == readings + bytes(48 - 32)  # the stamp of a SYNC without counter, and padding
    cob_id = device.get(0x1800, 1)
    device.set(0x1800, 1, cob_id | 1 << 31)
    device.set(0x1A00, 0, 0)
    device.set(0x1A00, 0, 9)
    device.set(0x1800, 1, cob_id)
    (frame,) = device.step(2, [SYNC]).frames
    assert frame.data == b"".join(n.to_bytes(2, "little") for n in range(1, 10)) + b"\0\0"


def test_sync_hook_runs_before_the_readings_are_sampled():
    device = Device(load_eds("skin-patch", 5), 5)
    view = device.image_view(0x6401, 1, 1)
    calls = []

    def sample(now_ns, counter):
        calls.append((now_ns, counter))
        view[0] = counter

    device.on_sync = sample
    device.step(0)
    device.step(1, [START])
    out = device.step(2, [Frame(0x80, b"\x07")]).frames
    assert calls == [(2, 7)]
    assert out[0].data[:2] == b"\x07\x00"


def test_host_may_refuse_an_rpdo_as_a_whole():
    device = Device(odd_od(), 3)
    device.step(0)
    device.step(0, [START])
    device.on_write = lambda index, sub, value: AbortCode.VALUE_INVALID if index == 0x2003 else None
    step = device.step(0, [Frame(0x203, b"\xff\xff\xff\xff")])
    assert [device.get(index) for index in (0x2000, 0x2001, 0x2002, 0x2003)] == [False, False, 0, -5]
    assert [event.kind for event in step.events] == ["dropped"]


@pytest.mark.parametrize("flags", [RTR, EXTENDED, 4, 8])
def test_frame_that_is_no_classic_data_frame_is_dropped(flags):
    bench = Bench("patch", state="op")
    bench.step([Frame(0x80, b"\x01", 0, flags), Frame(0, b"\x02\x00", 0, flags)])
    assert bench.sent == []
    assert bench.device.dropped == 2
    assert bench.device.nmt_state is NmtState.OPERATIONAL
    assert [event.kind for event in bench.events] == ["dropped", "dropped"]


def test_lss_bit_rate_is_handed_to_the_host_who_owns_the_interface():
    bench = Bench("patch")
    for text in ("7E5 04 01 00 00 00 00 00 00", "7E5 13 00 02 00 00 00 00 00", "7E5 15 64 00 00 00 00 00 00"):
        bench.step([bench.frame(text)])
    assert [(event.kind, event.detail) for event in bench.events] == [
        (EventKind.BIT_RATE, "500000 after 100 ms")
    ]
