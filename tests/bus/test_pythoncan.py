"""Interfaces of python-can: the virtual one, and udp_multicast, which crosses processes."""

import errno
import random
import socket
import time
from itertools import count
from types import SimpleNamespace

import can
import pytest

from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.frame import EXTENDED, RTR, Frame
from skinbus.errors import BusError
from tests.bus.cores import bare
from tests.own_bus import own_port

WAIT_S = 60.0  # nothing waits that long when all is well
GROUP = "239.74.163.2"
PORT = own_port()


def udp(**more):
    return PythonCanBus("udp_multicast", GROUP, options={"port": PORT}, **more)


def receive_until(bus, enough):
    """What a bus has heard once that is enough."""
    heard, give_up_s = [], time.monotonic() + WAIT_S
    while not enough(heard):
        assert time.monotonic() < give_up_s, f"{len(heard)} frames came"
        heard += bus.receive(1.0)
    return heard


def exchange(a, b, frames):
    """Send over a; what b has heard once as many frames have come."""
    assert a.send(frames) == len(frames)
    return receive_until(b, lambda heard: len(heard) >= len(frames))


CLASSIC = [
    Frame(0x000, b"\x01\x00"),
    Frame(0x80),
    Frame(0x7FF, bytes(range(8))),
    Frame(0x181, b"\x01", flags=EXTENDED),
    Frame(0x1FFFFFFF, flags=EXTENDED),
    Frame(0x701, flags=RTR),
    Frame(0x701, bytes(4), flags=RTR),
]


@pytest.mark.parametrize("kind", ["virtual", "udp_multicast"])
def test_frames_cross_unchanged_and_the_sender_does_not_hear_itself(kind):
    def make():
        return udp() if kind == "udp_multicast" else PythonCanBus("virtual", "unchanged")

    with make() as a, make() as b:
        assert bare(exchange(a, b, CLASSIC)) == bare(CLASSIC)
        assert bare(exchange(b, a, CLASSIC[:2])) == bare(CLASSIC[:2])
        assert a.receive() == b.receive() == []


def test_reception_goes_on_after_garbage_datagrams():
    with udp() as a, udp() as b, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        for junk in (b"", b"\xc1", b"hello", b"\x93\x01\x02\x03", random.Random(1).randbytes(200)):
            stranger.sendto(junk, (GROUP, PORT))
        assert bare(exchange(a, b, CLASSIC)) == bare(CLASSIC)


@pytest.mark.parametrize(
    ("error", "advice"),
    [
        (OSError(errno.EAFNOSUPPORT, "Address family not supported"), "kernel of this machine has no CAN"),
        (OSError(errno.EPERM, "Operation not permitted"), "may not open it"),
        (can.CanInitializationError("no such dongle"), "no such dongle"),
        (can.CanInterfaceNotImplementedError("no serial"), r"no serial; .*skinbus\[serial,multicast\]"),
    ],
)
def test_interface_that_cannot_be_opened_says_what_to_do(monkeypatch, error, advice):
    def fail(**settings):
        raise error

    monkeypatch.setattr(can, "Bus", fail)
    with pytest.raises(BusError, match=f"socketcan can7 cannot be opened: .*{advice}"):
        PythonCanBus("socketcan", "can7")


class Scripted:
    """Stands in for python-can's bus: each send takes the next outcome."""

    def __init__(self, outcomes):
        self.outcomes = list(outcomes)
        self.sent = []

    def send(self, message, timeout=None):
        outcome = self.outcomes.pop(0) if self.outcomes else None
        if outcome is not None:
            raise outcome
        self.sent.append(message.arbitration_id)

    def shutdown(self):
        pass

    def fileno(self):
        return -1


DOWN = can.CanOperationError("Failed to receive: Network is down", errno.ENETDOWN)
FULL = can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)


@pytest.fixture
def scripted(monkeypatch):
    def make(*outcomes):
        fake = Scripted(outcomes)
        monkeypatch.setattr(can, "Bus", lambda **settings: fake)
        return fake, PythonCanBus("socketcan", "can0")

    return make


@pytest.mark.parametrize("full", [FULL, can.CanOperationError("Transmit buffer full"), can.CanTimeoutError()])
def test_full_send_buffer_is_waited_for(scripted, full):
    fake, bus = scripted(full, full, None, full, None)
    assert bus.send([Frame(1), Frame(2)]) == 2
    assert fake.sent == [1, 2]


def test_send_buffer_that_stays_full_costs_frames_but_does_not_block(scripted, monkeypatch):
    now_s = count()
    clocks = SimpleNamespace(monotonic=lambda: float(next(now_s)), sleep=lambda s: None)
    monkeypatch.setattr("skinbus.bus.pythoncan.time", clocks)
    fake, bus = scripted(*[FULL] * 4)
    assert bus.send([Frame(1), Frame(2), Frame(3), Frame(4), Frame(5)]) == 1
    assert fake.sent == [5]


@pytest.mark.parametrize("code", [errno.ENETDOWN, errno.ENXIO, errno.ENODEV, errno.EBADF])
def test_bus_that_is_gone_raises_on_send(scripted, code):
    _, bus = scripted(can.CanOperationError("Failed to transmit", code))
    with pytest.raises(BusError, match="sending failed"):
        bus.send([Frame(1)])


@pytest.mark.parametrize("error", [DOWN, OSError(errno.EIO, "gone"), RuntimeError("unplugged")])
def test_library_that_fails_at_closing_is_a_fault_of_the_bus(scripted, monkeypatch, error):
    def fail(bus):
        raise error

    monkeypatch.setattr(Scripted, "shutdown", fail)
    _, bus = scripted()
    with pytest.raises(BusError, match="socketcan can0: closing failed"):
        bus.close()
