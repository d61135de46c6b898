"""The length of a frame on the wire, against bit strings written out one bit after another."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbus.can.classic import worst_case_bits
from skinbus.can.frame import ERROR, EXTENDED, FD, RTR, Frame
from skinbus.can.wire_bits import frame_bits

END = (
    "1" + "1" + "1" + "1" * 7 + "1" * 3
)  # CRC delimiter, ACK slot, ACK delimiter, end of frame, interframe space


def crc15(bits):
    """The remainder of dividing by the generator, by pencil and paper."""
    generator = "1100010110011001"  # x^15+x^14+x^10+x^8+x^7+x^4+x^3+1
    remainder = list(bits + "0" * 15)
    for i in range(len(bits)):
        if remainder[i] == "1":
            for k, digit in enumerate(generator):
                remainder[i + k] = "0" if remainder[i + k] == digit else "1"
    return "".join(remainder[-15:])


def stuff(bits):
    """Put the opposite bit after five equal ones, looking at what has been written."""
    written = ""
    for bit in bits:
        written += bit
        if written.endswith(("00000", "11111")) and not written.endswith(("000000", "111111")):
            written += "1" if bit == "0" else "0"
    return written


def binary(value, n):
    """The n bits of a number."""
    return f"{value:0{n}b}"


def identifier_bits(frame):
    """The start of a frame and its identifier; SRR and IDE are in the middle of an extended one."""
    if frame.flags & EXTENDED:
        bits = binary(frame.can_id, 29)
        return "0" + bits[:11] + "11" + bits[11:]
    return "0" + binary(frame.can_id, 11)


def on_the_wire(frame):
    """All bits of a frame in their order."""
    is_remote = bool(frame.flags & RTR)
    written = identifier_bits(frame) + str(int(is_remote)) + "00" + binary(len(frame.data), 4)
    if not is_remote:
        written += "".join(binary(byte, 8) for byte in frame.data)
    return stuff(written + crc15(written)) + END


data_bytes = st.binary(max_size=8) | st.lists(st.sampled_from([0, 0xFF, 0x0F, 0x1F, 0xF8]), max_size=8).map(
    bytes
)
frames = st.builds(
    lambda extended, number, data, remote: Frame(
        number if extended else number & 0x7FF, data, 0, extended | remote
    ),
    st.sampled_from([0, EXTENDED]),
    st.integers(0, 0x1FFFFFFF),
    data_bytes,
    st.sampled_from([0, RTR]),
)


def test_oracle_crc_has_the_catalogued_check_value():
    # CRC-15/CAN of "123456789" is 0x059E (catalogue of parametrised CRC algorithms, G. Cook).
    assert int(crc15("".join(f"{byte:08b}" for byte in b"123456789")), 2) == 0x059E


def test_known_frame_of_zeros():
    # 34 zeros: a stuff bit after every fifth, which is six; ten fixed, three between the frames.
    assert frame_bits(Frame(0, b"")) == 34 + 6 + 13


@given(frames)
def test_length_is_that_of_the_bits_written_out_and_at_most_the_worst_case(frame):
    length = 0 if frame.flags & RTR else len(frame.data)
    assert frame_bits(frame) == len(on_the_wire(frame))
    assert frame_bits(frame) <= worst_case_bits(length) or frame.flags & EXTENDED


def test_bounds_are_the_published_ones():
    assert [worst_case_bits(0), worst_case_bits(8)] == [55, 135]


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x800),
        Frame(-1),
        Frame(1 << 29, flags=EXTENDED),
        Frame(1, bytes(9)),
        Frame(1, flags=FD),
        Frame(1, flags=ERROR),
    ],
)
def test_what_classic_can_cannot_carry_is_refused(frame):
    with pytest.raises(ValueError, match=r"range|bytes|classic"):
        frame_bits(frame)
