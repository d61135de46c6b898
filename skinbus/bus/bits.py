"""How long a classic CAN frame is on the wire: exact number of bits, with stuffing and CRC, and its bounds.

The fields from start of frame to the end of the CRC are stuffed: after five equal bits the opposite one
is inserted, and the inserted bit counts for the next run. What follows is fixed: CRC delimiter, ACK slot
and delimiter, seven bits end of frame, three bits interframe space. Source: ISO 11898-1, 10.4 and 10.5;
CRC polynomial 0x4599.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
from numba import njit

from skinbus.bus.frame import ERROR, EXTENDED, FD, RTR, Frame, FrameBatch

MAX_CLASSIC_DATA: Final = 8
INTERFRAME_BITS: Final = 3
END_BITS: Final = 10
"""CRC delimiter, ACK slot, ACK delimiter and end of frame; never stuffed."""

_HEADER_BITS: Final = 19  # start, 11 identifier, RTR, IDE, r0, 4 length
_EXTENDED_HEADER_BITS: Final = 39  # start, 11 identifier, SRR, IDE, 18 identifier, RTR, r1, r0, 4 length
_CRC_BITS: Final = 15
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
    if len(frame.data) > MAX_CLASSIC_DATA:
        return "more than 8 bytes"
    return ""


def classic_bits(frame: Frame) -> int:
    """The same as ``frame_bits`` for a frame already known to be a classic one."""
    can_id, data, _, flags, _ = frame
    return int(_bits(can_id, flags, len(data), _word(data[:4]), _word(data[4:])))


def batch_bits(batch: FrameBatch) -> npt.NDArray[np.int64]:
    """Bit times of every frame of the batch, as (n,) int64; 0 where classic CAN cannot carry the frame."""
    rows = batch.frames[: batch.n]
    bits = np.empty(batch.n, np.int64)
    _bits_of_rows(rows["can_id"], rows["length"], rows["flags"], rows["data"], bits)
    return bits


def best_case_bits(length: int, *, extended: bool = False) -> int:
    """Bit times of a data frame with ``length`` bytes if no bit were stuffed, interframe space included."""
    return _stuffable(length, extended=extended) + END_BITS + INTERFRAME_BITS


def worst_case_bits(length: int, *, extended: bool = False) -> int:
    """Bit times of a data frame with ``length`` bytes and as many stuff bits as can be.

    Source: Davis, Burns, Bril, Lukkien, "Controller Area Network schedulability analysis", 2007, eq. 1-2.
    """
    stuffable = _stuffable(length, extended=extended)
    return stuffable + (stuffable - 1) // 4 + END_BITS + INTERFRAME_BITS


def _stuffable(length: int, *, extended: bool) -> int:
    if not 0 <= length <= MAX_CLASSIC_DATA:
        raise ValueError(f"length is {length}; wanted 0..{MAX_CLASSIC_DATA}")
    return (_EXTENDED_HEADER_BITS if extended else _HEADER_BITS) + 8 * length + _CRC_BITS


def _word(data: bytes) -> int:
    """Up to four bytes as the upper end of a 32-bit word."""
    return int.from_bytes(data, "big") << (32 - 8 * len(data))


@njit(cache=True, nogil=True)
def _bits(can_id: Any, flags: Any, length: Any, high: Any, low: Any) -> int:
    """Bits on the wire of a classic frame whose data, left-adjusted, are the 32-bit words high and low."""
    remote = 1 if flags & RTR else 0
    # The header as one number, first bit on the wire uppermost; start of frame is a zero.
    if flags & EXTENDED:
        n_header = _EXTENDED_HEADER_BITS
        header = ((can_id >> 18) << 27) | (3 << 25) | ((can_id & 0x3FFFF) << 7) | (remote << 6) | length
    else:
        n_header = _HEADER_BITS
        header = (can_id << 7) | (remote << 6) | length
    n_data = 0 if remote else 8 * length

    crc = 0
    stuffed = 0
    last = -1
    run = 0
    n_checked = n_header + n_data
    for i in range(n_checked + _CRC_BITS):
        if i < n_header:
            bit = (header >> (n_header - 1 - i)) & 1
        elif i < n_checked:
            k = i - n_header
            bit = (high >> (31 - k)) & 1 if k < 32 else (low >> (63 - k)) & 1
        else:
            bit = (crc >> (n_checked + _CRC_BITS - 1 - i)) & 1
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
    return n_checked + _CRC_BITS + stuffed + END_BITS + INTERFRAME_BITS


@njit(cache=True, nogil=True)
def _bits_of_rows(can_ids: Any, lengths: Any, flags: Any, data: Any, bits: Any) -> None:
    """Fill ``bits`` with the length of every row."""
    for i in range(len(bits)):
        extended = flags[i] & EXTENDED
        if flags[i] & (FD | ERROR) or lengths[i] > 8 or can_ids[i] > (0x1FFFFFFF if extended else 0x7FF):
            bits[i] = 0
            continue
        high = np.int64(0)
        low = np.int64(0)
        for k in range(min(4, lengths[i])):
            high |= np.int64(data[i, k]) << (24 - 8 * k)
        for k in range(4, lengths[i]):
            low |= np.int64(data[i, k]) << (56 - 8 * k)
        bits[i] = _bits(np.int64(can_ids[i]), np.int64(flags[i]), np.int64(lengths[i]), high, low)
