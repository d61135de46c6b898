"""How long a classic CAN frame is on the wire: exact number of bits, with stuffing and CRC, by its bits.

The fields from start of frame to the end of the CRC are stuffed: after five equal bits the opposite one
is inserted, and the inserted bit counts for the next run. What follows is fixed: CRC delimiter, ACK slot
and delimiter, seven bits end of frame, three bits interframe space. Source: ISO 11898-1, 10.4 and 10.5;
CRC polynomial 0x4599.
"""

from __future__ import annotations

from typing import Any, Final

from skinbus.can.classic import (
    CRC_BITS,
    END_BITS,
    EXTENDED_HEADER_BITS,
    HEADER_BITS,
    INTERFRAME_BITS,
    MAX_DATA,
)
from skinbus.can.frame import ERROR, EXTENDED, FD, RTR, Frame
from skinbus.jit import kernel

_CRC_POLYNOMIAL: Final = 0x4599


def frame_bits(frame: Frame) -> int:
    """Bit times that the frame takes on the wire, interframe space included.

    Of a remote frame ``data`` gives the length that is asked for; its bytes do not travel.
    Raises ValueError for what classic CAN cannot carry.
    """
    fault = classic_fault(frame)
    if fault:
        raise ValueError(f"{fault}: {frame}")
    return classic_bits(frame)


def classic_fault(frame: Frame) -> str:
    """Why classic CAN cannot carry the frame; empty if it can."""
    if frame.flags & (FD | ERROR):
        return "not a classic data or remote frame"
    if not 0 <= frame.can_id <= (0x1FFF_FFFF if frame.flags & EXTENDED else 0x7FF):
        return "identifier out of range"
    if len(frame.data) > MAX_DATA:
        return "more than 8 bytes"
    return ""


def classic_bits(frame: Frame) -> int:
    """The same as ``frame_bits`` for a frame already known to be a classic one."""
    can_id, data, _, flags, _ = frame
    return int(_bits(can_id, flags, len(data), _word(data[:4]), _word(data[4:])))


def _word(data: bytes) -> int:
    """Up to four bytes as the upper end of a 32-bit word."""
    return int.from_bytes(data, "big") << (32 - 8 * len(data))


@kernel
def _bits(can_id: Any, flags: Any, length: Any, high: Any, low: Any) -> int:
    """Bits on the wire of a classic frame whose data, left-adjusted, are the 32-bit words high and low."""
    remote = 1 if flags & RTR else 0
    # The header as one number, first bit on the wire uppermost; start of frame is a zero.
    if flags & EXTENDED:
        n_header = EXTENDED_HEADER_BITS
        header = ((can_id >> 18) << 27) | (3 << 25) | ((can_id & 0x3FFFF) << 7) | (remote << 6) | length
    else:
        n_header = HEADER_BITS
        header = (can_id << 7) | (remote << 6) | length
    n_data = 0 if remote else 8 * length

    crc = 0
    stuffed = 0
    last = -1
    run = 0
    n_checked = n_header + n_data
    for i in range(n_checked + CRC_BITS):
        if i < n_header:
            bit = (header >> (n_header - 1 - i)) & 1
        elif i < n_checked:
            k = i - n_header
            bit = (high >> (31 - k)) & 1 if k < 32 else (low >> (63 - k)) & 1
        else:
            bit = (crc >> (n_checked + CRC_BITS - 1 - i)) & 1
        if i < n_checked:
            feedback = bit ^ (crc >> 14)
            crc = (crc << 1) & 0x7FFF
            if feedback:
                crc ^= _CRC_POLYNOMIAL
        if bit == last:
            run += 1
        else:
            last = bit
            run = 1
        # The stuff bit is the first of the next run; one is due even after the last bit of the CRC.
        if run == 5:
            stuffed += 1
            last = 1 - bit
            run = 1
    return n_checked + CRC_BITS + stuffed + END_BITS + INTERFRAME_BITS
