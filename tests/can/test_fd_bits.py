"""CAN FD frames on the wire, against bit strings written out one bit after another."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.can.fd import LENGTHS
from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, RTR, Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.can.wire_bits import fault, fd_bits
from tests.bus.cores import Talker
from tests.can.test_classic_bits import binary, identifier_bits, stuff

BITRATE, DATA_BITRATE = 1_000_000, 5_000_000


def on_the_wire(frame):
    """Bits before the switch and after the CRC delimiter; bits between."""
    ide = "" if frame.flags & EXTENDED else "0"
    header = identifier_bits(frame) + "0" + ide + "10" + str(int(bool(frame.flags & BRS)))
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
    extended = draw(st.booleans())
    can_id = draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF))
    n = draw(st.sampled_from(LENGTHS))
    data = draw(st.binary(min_size=n, max_size=n) | st.sampled_from([bytes(n), b"\xff" * n]))
    flags = FD | (EXTENDED if extended else 0) | draw(st.sampled_from([0, BRS, ESI, BRS | ESI]))
    return Frame(can_id, data, 0, flags)


@given(fd_frames())
def test_length_is_that_of_the_bits_written_out(frame):
    slow, fast = map(len, on_the_wire(frame))
    assert fd_bits(frame) == ((slow, fast) if frame.flags & BRS else (slow + fast, 0))


def test_known_frame_of_zeros():
    # Two stuff bits among the 14 zeros before FDF; after the switch, one in five of the 512 zeros of data.
    assert fd_bits(Frame(0, bytes(64), 0, FD | BRS)) == (30 + 2, 5 + 512 + 102 + 32)


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
    port = wire.attach(Talker([(0, frame)]))
    wire.run(1_000_000)
    assert (wire.n_frames, port.refused) == (0, 1)
