"""CAN FD frames on the wire, against bit strings written out one bit after another."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.can.fd import LENGTHS, worst_case_bits
from skinbus.can.frame import BRS, ERROR, ESI, FD, RTR, Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.can.wire_bits import fault
from tests.bus.cores import Talker
from tests.can.test_classic_bits import binary, identifier_bits, stuff

BITRATE, DATA_BITRATE = 1_000_000, 5_000_000


def on_the_wire(frame):
    """Bits before the switch and after the CRC delimiter; bits between."""
    header = identifier_bits(frame) + "0010" + str(int(bool(frame.flags & BRS)))
    body = str(int(bool(frame.flags & ESI))) + binary(LENGTHS.index(len(frame.data)), 4)
    body += "".join(binary(byte, 8) for byte in frame.data)
    slow = stuff(header)
    fast = (stuff(header + body[:-1]) + body[-1])[len(slow) :]  # none after the very last bit
    check = "c" * (4 + (17 if len(frame.data) <= 16 else 21))  # stuff count and CRC
    fast += "".join("f" + check[k : k + 4] for k in range(0, len(check), 4))
    end = "1" + "0" + "1" + "1" * 7 + "1" * 3  # CRC delimiter, ACK slot and delimiter, end, interframe
    return slow + end, fast


@st.composite
def fd_frames(draw):
    can_id = draw(st.integers(0, 0x7FF))
    n = draw(st.sampled_from(LENGTHS))
    data = draw(st.binary(min_size=n, max_size=n) | st.sampled_from([bytes(n), b"\xff" * n]))
    flags = FD | draw(st.sampled_from([0, BRS, ESI, BRS | ESI]))
    return Frame(can_id, data, 0, flags)


@given(fd_frames())
def test_no_frame_is_longer_than_the_worst_case(frame):
    slow, fast = map(len, on_the_wire(frame))
    bound = worst_case_bits(len(frame.data))
    assert slow <= bound.nominal
    assert slow + fast <= sum(bound)
    assert bound.ns(BITRATE, DATA_BITRATE) >= 1000 * slow + 200 * fast


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x181, bytes(9), flags=FD),
        Frame(0x181, bytes(65), flags=FD),
        Frame(0x181, bytes(8), flags=FD | RTR | ERROR),
        Frame(0x800, bytes(8), flags=FD),
        Frame(0x181, bytes(9)),
    ],
)
def test_what_can_fd_cannot_carry_has_a_fault_and_is_refused_by_the_wire(frame):
    assert fault(frame, fd=True)
    wire = VirtualBus(BITRATE, data_bitrate=DATA_BITRATE)
    wire.attach(Talker([(0, frame)]))
    frames = []
    wire.tap(frames.append)
    wire.run(1_000_000)
    assert not frames
