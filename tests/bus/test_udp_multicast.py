"""Datagrams: those of python-can are frames, all others cost nothing; nobody from outside is heard."""

import socket
import tracemalloc

import can
import msgpack
import pytest

from skinbus.bus.pythoncan import PythonCanBus
from skinbus.bus.udp_multicast import MAX_DATAGRAM, pack_datagram, unpack_datagram
from skinbus.errors import BusError
from tests.own_bus import own_group, own_port

MESSAGE = can.Message(arbitration_id=0x181, is_extended_id=False, data=bytes(8), channel="0011")
FIELDS = msgpack.unpackb(pack_datagram(MESSAGE))


@pytest.mark.parametrize(
    "message",
    [
        MESSAGE,
        can.Message(arbitration_id=0x1FFF_FFFF, data=bytes(64), is_fd=True, channel="x" * 64),
        can.Message(arbitration_id=0x80, is_extended_id=False, is_remote_frame=True, dlc=4),
    ],
    ids=["classic", "fd", "remote"],
)
def test_messages_of_python_can_cross_unchanged(message):
    datagram = pack_datagram(message)
    assert len(datagram) <= MAX_DATAGRAM
    assert can.Message(**unpack_datagram(datagram)).equals(message, timestamp_delta=None, check_channel=True)


WRONG = {
    "a number for bytes": {"data": 2**32},
    "a list of bytes": {"data": [0] * 100},
    "too many bytes": {"data": bytes(65), "dlc": 65},
    "another length": {"dlc": 3},
    "a length below zero": {"dlc": -1, "is_remote_frame": True},
    "a long remote frame": {"dlc": 2**60, "is_remote_frame": True, "data": b""},
    "an identifier of 30 bits": {"arbitration_id": 1 << 29},
    "a flag for an identifier": {"arbitration_id": True},
    "a fraction": {"arbitration_id": 1.5},
    "a text for a flag": {"is_fd": "yes"},
    "a long channel": {"channel": "x" * 65},
    "no identifier": {"arbitration_id": None},
}


@pytest.mark.parametrize("change", WRONG.values(), ids=WRONG)
def test_what_is_no_frame_is_none_and_costs_nothing(change):
    datagram = msgpack.packb(FIELDS | change)
    tracemalloc.start()
    assert unpack_datagram(datagram) is None
    peak = tracemalloc.get_traced_memory()[1]  # of all threads; what these ask for is gigabytes
    tracemalloc.stop()
    assert peak < 1_000_000


@pytest.mark.parametrize("datagram", [b"", b"\xc1", b"\xdf\xff\xff\xff\xff", bytes(60_000), b"\x91" * 500])
def test_what_is_no_map_is_none(datagram):
    assert unpack_datagram(datagram) is None


def test_a_datagram_to_this_machine_alone_is_not_received():
    datagram, group, port = pack_datagram(MESSAGE), own_group(), own_port()
    with (
        PythonCanBus("udp_multicast", group, options={"port": port}) as bus,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        sender.sendto(datagram, ("127.0.0.1", port))  # the one that must not come
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        sender.sendto(datagram, (group, port))
        assert len(bus.receive(1.0)) == 1
        assert bus.receive(0.0) == []


@pytest.mark.parametrize("group", ["10.0.0.1", "240.0.0.1", "300.1.2.3", "can0"])
def test_what_is_no_group_is_refused_by_its_name(group):
    with pytest.raises(BusError, match=f"{group} is no multicast group"):
        PythonCanBus("udp_multicast", group)
