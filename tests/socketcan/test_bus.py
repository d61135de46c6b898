"""Frames through the kernel: what is sent is received, sorted by plane, stamped, counted; losses are told."""

import os
import time
from pathlib import Path

import can
import pytest

from skinbus.bus.socketcan import SocketCanBus
from skinbus.bus.socketcan_batch import to_frames
from skinbus.can.event import EventKind
from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, Frame
from skinbus.errors import BusError
from tests.cli.patience import wait_until
from tests.socketcan.can_rig import ip
from tests.socketcan.frames import EVERY_KIND
from tests.socketcan.skin_rig import PATIENCE_S

SLACK_NS = 1_000_000


def without_time(frames):
    return [frame._replace(t_ns=0) for frame in frames]


def receive_all(bus, n):
    """Receive n control frames."""
    frames = []
    wait_until(lambda: frames.extend(bus.receive(0.1)) or len(frames) >= n)
    return frames


LAST = Frame(0x702, b"\0")
"""The kernel hands frames on in lots, when it can: what was sent before this one has come with it."""


def receive_until_last(bus):
    """Receive up to ``LAST``, on the control plane; return the frames of both planes."""
    control, data, give_up_s = [], [], time.monotonic() + PATIENCE_S
    while LAST.can_id not in [frame.can_id for frame in control]:
        assert time.monotonic() < give_up_s
        control += bus.receive(0.1)
        data += to_frames(bus.batch)
    control += bus.receive()  # the planes are read one after the other
    data += to_frames(bus.batch)
    return control, data


def test_every_kind_of_frame_arrives_as_it_was_sent(channel):
    with SocketCanBus(channel) as sender, SocketCanBus(channel) as receiver:
        assert sender.send(EVERY_KIND) == len(EVERY_KIND)
        assert without_time(receive_all(receiver, len(EVERY_KIND))) == EVERY_KIND
        assert sender.receive() == []  # never its own


def test_fd_frames_arrive_as_they_were_sent(channel):
    frames = [Frame(0x181, bytes(range(64)), flags=FD | BRS), Frame(0x182, bytes(12), flags=FD | ESI)]
    with SocketCanBus(channel, fd=True) as sender, SocketCanBus(channel, fd=True) as receiver:
        assert sender.send([*frames, *EVERY_KIND]) == 2 + len(EVERY_KIND)
        assert without_time(receive_all(receiver, 2 + len(EVERY_KIND))) == [*frames, *EVERY_KIND]
    with SocketCanBus(channel) as classic:
        assert classic.send(frames) == 0


def test_python_can_sees_what_we_send_and_we_what_it_sends(channel):
    with SocketCanBus(channel) as ours, can.Bus(channel, interface="socketcan") as theirs:
        ours.send([Frame(0x181, b"\1\2\3")])
        message = theirs.recv(PATIENCE_S)
        assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (
            0x181,
            b"\1\2\3",
            False,
        )
        theirs.send(can.Message(arbitration_id=0x12345, data=b"\7", is_extended_id=True))
        assert without_time(receive_all(ours, 1)) == [Frame(0x12345, b"\7", flags=EXTENDED)]


def test_planes_are_sorted_by_the_kernel(channel):
    data_ids = frozenset({0x181, 0x182})
    with SocketCanBus(channel) as sender, SocketCanBus(channel) as receiver:
        receiver.listen(data_ids | {0x701, 0x702}, data_ids)
        sender.send([Frame(0x181, b"\1"), Frame(0x701, b"\5"), Frame(0x182, b"\2"), Frame(0x300, b"")])
        sender.send([Frame(0x181, b"\3", flags=EXTENDED), LAST])
        control, data = receive_until_last(receiver)
        assert without_time(control) == [Frame(0x701, b"\5"), LAST]
        assert without_time(data) == [Frame(0x181, b"\1"), Frame(0x182, b"\2")]


def test_stamps_are_of_the_reception_in_order_and_on_our_clock(channel):
    with SocketCanBus(channel) as sender, SocketCanBus(channel) as receiver:
        for _ in range(10):
            begin_ns = time.monotonic_ns()
            for _ in range(100):
                sender.send([Frame(0x181, b"")])
            end_ns = time.monotonic_ns()
            time.sleep(0.05)  # what is read late keeps its time
            stamps = [frame.t_ns for frame in receive_all(receiver, 100)]
            assert sorted(stamps) == stamps
            # Two clocks are read one after the other, and the kernel hands frames on when it can: a machine
            # that holds one of them up for longer is tried again.
            if begin_ns - SLACK_NS <= stamps[0] < stamps[-1] <= end_ns + SLACK_NS:
                break
        else:
            raise AssertionError((begin_ns, stamps[0], stamps[-1], end_ns))


@pytest.mark.parametrize("n", [1, 7, 8, 255, 256, 257, 1000])
def test_bursts_of_any_length_arrive_whole_and_in_order(channel, n):
    frames = [Frame(0x181 + i % 4, i.to_bytes(8, "little")) for i in range(n)]
    with SocketCanBus(channel) as sender, SocketCanBus(channel) as receiver:
        receiver.listen(frozenset({0x181, 0x182, 0x183, 0x184}), frozenset({0x181, 0x182, 0x183, 0x184}))
        assert sender.send(frames) == n
        heard, give_up_s = [], time.monotonic() + PATIENCE_S
        while len(heard) < n and time.monotonic() < give_up_s:
            assert receiver.receive(1.0) == []
            heard += to_frames(receiver.batch)
        assert without_time(heard) == frames
        assert receiver.n_dropped == 0


def receive_until_all_are_accounted(sender, receiver, n_sent):
    """Receive and count until nothing that was sent is missing; how many were sent in the end."""
    give_up_s = time.monotonic() + PATIENCE_S
    while receiver.n_received + receiver.n_dropped < n_sent:
        assert time.monotonic() < give_up_s, (n_sent, receiver.n_received, receiver.n_dropped)
        n_sent += sender.send([Frame(0x181, b"")])  # a socket's counter comes with the frame after the loss
        receiver.receive(0.1)
    return n_sent


def test_what_the_kernel_drops_is_counted_and_reported(channel):
    with SocketCanBus(channel) as sender, SocketCanBus(channel, receive_buffer=4096) as receiver:
        receiver.listen(frozenset({0x181}), frozenset({0x181}))
        n_sent = sender.send([Frame(0x181, i.to_bytes(8, "little")) for i in range(5000)])
        assert n_sent == 5000
        n_sent = receive_until_all_are_accounted(sender, receiver, n_sent)
        assert receiver.n_received + receiver.n_dropped == n_sent
        assert 0 < receiver.n_received < n_sent
        events = receiver.news()
        assert {event.kind for event in events} == {EventKind.FRAMES_DROPPED}
        assert sum(event.count for event in events) == receiver.n_dropped
        assert receiver.news() == []


def test_what_is_dropped_on_the_way_to_the_socket_is_counted_and_reported(channel):
    """A sender that lets nobody else run keeps the kernel from handing frames on; its backlog overflows."""
    policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    dropped = Path(f"/sys/class/net/{channel}/statistics/rx_dropped")
    with SocketCanBus(channel) as sender, SocketCanBus(channel) as receiver:
        receiver.listen(frozenset({0x181}), frozenset({0x181}))
        n_sent = 0
        give_up_s = time.monotonic() + PATIENCE_S
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
        try:
            while not int(dropped.read_text()):
                assert time.monotonic() < give_up_s
                n_sent += sender.send([Frame(0x181, bytes(8))] * 4000)
                receiver.receive()
        finally:
            os.sched_setscheduler(0, policy, parameter)
        n_sent = receive_until_all_are_accounted(sender, receiver, n_sent)
        assert receiver.n_received + receiver.n_dropped == n_sent
        assert sum(event.count for event in receiver.news()) == receiver.n_dropped >= 1


def test_an_interface_that_goes_down_is_an_error_at_once_and_can_be_opened_again(channel):
    with SocketCanBus(channel) as bus:
        bus.listen(frozenset({0x181, 0x701}), frozenset({0x181}))
        ip("link", "set", channel, "down")
        with pytest.raises(BusError, match="down"):
            bus.receive(1.0)
        with pytest.raises(BusError, match="down"):
            bus.send([Frame(0x80, b"")])
    with pytest.raises(BusError, match=f"bring it up: ip link set {channel} up"):
        SocketCanBus(channel)
    ip("link", "set", channel, "up")
    with SocketCanBus(channel) as bus:
        assert bus.send([Frame(0x80, b"")]) == 1


def test_error_frames_become_events(channel):
    def error(can_id, state=0):
        return can.Message(
            arbitration_id=can_id,
            is_error_frame=True,
            is_extended_id=False,
            data=bytes([0, state, 0, 0, 0, 0, 130, 96]),
        )

    with SocketCanBus(channel) as bus, can.Bus(channel, interface="socketcan") as adapter:
        bus.listen(frozenset({0x80}))
        for message in (
            error(0x004, 0x0C),
            error(0x004, 0x20),
            error(0x040),
            error(0x040),
            error(0x100),
            error(4, 1),
        ):
            adapter.send(message)
        events, give_up_s = [], time.monotonic() + PATIENCE_S
        while len(events) < 7 and time.monotonic() < give_up_s:
            assert bus.receive(0.1) == []  # 0x040 is no frame of ours
            events += bus.news()
        assert [event.kind for event in events] == [
            EventKind.ERROR_WARNING,
            EventKind.ERROR_PASSIVE,
            EventKind.BUS_OFF,
            EventKind.BUS_OFF_END,
            EventKind.ERROR_PASSIVE_END,
            EventKind.ERROR_WARNING_END,
            EventKind.CONTROLLER_OVERFLOW,
        ]
        assert bus.news() == []


def test_hostile_flags_of_error_frames_do_not_reach_a_core(channel):
    with SocketCanBus(channel) as bus, can.Bus(channel, interface="socketcan") as adapter:
        adapter.send(
            can.Message(arbitration_id=0x080, is_error_frame=True, is_extended_id=False, data=bytes(8))
        )
        adapter.send(can.Message(arbitration_id=0x701, data=b"\5", is_extended_id=False))
        frames = receive_all(bus, 1)
        assert [frame.flags & ERROR for frame in frames] == [0]
