"""How long a classic frame is on the wire: its exact bits, with stuffing and CRC; what CAN and CAN FD carry.

Up to the end of the CRC the opposite bit is inserted after five equal ones, and counts for the next run.
Source: ISO 11898-1:2015, 10.4 and 10.5. Frames of CAN FD are taken to be as long as they can be: ``fd``.
"""

from __future__ import annotations

import re
from functools import lru_cache

from skinbus.can.classic import (
    CRC_BITS,
    END_BITS,
    EXTENDED_HEADER_BITS,
    HEADER_BITS,
    INTERFRAME_BITS,
    MAX_DATA,
)
from skinbus.can.fd import LENGTHS
from skinbus.can.frame import ERROR, EXTENDED, FD, RTR, Frame

_STUFFED = re.compile("0{5}(?:1{4}0{4})*(?:1{4})?|1{5}(?:0{4}1{4})*(?:0{4})?")
"""Bits after which one is inserted: five equal ones, then each four that are equal to the inserted one."""


def _crc15(number: int) -> int:
    """Return the remainder of eight bits before the CRC (polynomial 0x4599)."""
    crc = number << 7
    for _ in range(8):
        crc = crc << 1 ^ (0x4599 if crc & 0x4000 else 0)
    return crc & 0x7FFF


_CRC15 = [_crc15(byte) for byte in range(256)]


def fault(frame: Frame, *, fd: bool = False) -> str:
    """Why classic CAN, or CAN FD too, cannot carry the frame; empty if it can."""
    can_id, data, _, flags, _ = frame
    if flags & (ERROR if fd else FD | ERROR) or (flags & FD and flags & RTR):
        return "not a classic data or remote frame"
    if not 0 <= can_id <= (0x1FFF_FFFF if flags & EXTENDED else 0x7FF):
        return "identifier out of range"
    if flags & FD:
        return "" if len(data) in LENGTHS else "no length of CAN FD"
    return "more than 8 bytes" if len(data) > MAX_DATA else ""


def frame_bits(frame: Frame) -> int:
    """Bit times that a classic frame takes on the wire, interframe space included.

    Of a remote frame ``data`` gives the length that is asked for; its bytes do not travel.

    Raises:
        ValueError: classic CAN cannot carry it.
    """
    if found := fault(frame):
        raise ValueError(f"{found}: {frame}")
    return classic_bits(frame.can_id, frame.data, frame.flags)


@lru_cache(maxsize=4096)  # most frames of a skin repeat an earlier one
def classic_bits(can_id: int, data: bytes, flags: int) -> int:
    """The same as ``frame_bits`` for a frame already known to be a classic one."""
    control = (0x40 if flags & RTR else 0) | len(data)
    body = b"" if flags & RTR else data
    # The header as one number, first bit uppermost; start of frame is a zero.
    if flags & EXTENDED:
        n, head = EXTENDED_HEADER_BITS, ((can_id >> 18) << 27) | (3 << 25) | ((can_id & 0x3FFFF) << 7)
    else:
        n, head = HEADER_BITS, can_id << 7
    crc, n = 0, n + 8 * len(body)
    checked = (head | control) << 8 * len(body) | int.from_bytes(body, "big")
    for byte in checked.to_bytes(-(-n // 8), "big"):  # zeros before the first bit change nothing
        crc = (crc << 8 ^ _CRC15[crc >> 7 ^ byte]) & 0x7FFF
    n += CRC_BITS
    runs = _STUFFED.findall(f"{checked << CRC_BITS | crc:0{n}b}")
    return n + sum(len(run) // 4 for run in runs) + END_BITS + INTERFRAME_BITS
