"""How long a frame is on the wire: its exact bits, with stuffing and CRC; what classic CAN and CAN FD carry.

Up to the end of the CRC of classic CAN, or of the data of CAN FD, the opposite bit is inserted after five
equal ones, and counts for the next run. Stuff count and CRC of CAN FD have stuff bits at fixed places, the
first of which stands for one that the data might have called for. Source: ISO 11898-1:2015, 10.4 and 10.5.
"""

from __future__ import annotations

import re

from skinbus.can import fd as canfd
from skinbus.can.classic import (
    CRC_BITS,
    END_BITS,
    EXTENDED_HEADER_BITS,
    HEADER_BITS,
    INTERFRAME_BITS,
    MAX_DATA,
)
from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, RTR, Frame

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
        return "" if len(data) in canfd.LENGTHS else "no length of CAN FD"
    return "more than 8 bytes" if len(data) > MAX_DATA else ""


def frame_bits(frame: Frame) -> int:
    """Bit times that a classic frame takes on the wire, interframe space included.

    Of a remote frame ``data`` gives the length that is asked for; its bytes do not travel.

    Raises:
        ValueError: classic CAN cannot carry it.
    """
    if found := fault(frame):
        raise ValueError(f"{found}: {frame}")
    return classic_bits(frame)


def classic_bits(frame: Frame) -> int:
    """The same as ``frame_bits`` for a frame already known to be a classic one."""
    can_id, data, _, flags, _ = frame
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


def fd_bits(frame: Frame) -> canfd.PhaseBits:
    """Return the bits of an FD frame that can be carried; without the switch (BRS) all are nominal."""
    can_id, data, _, flags, _ = frame
    switch = 1 if flags & BRS else 0
    # Before the switch: FDF is the recessive bit before a reserved zero. Error state and length code follow.
    if flags & EXTENDED:
        n_slow = canfd.HEADER_BITS + canfd.EXTENDED_BITS
        slow = ((can_id >> 18) << 24) | (3 << 22) | ((can_id & 0x3FFFF) << 4) | 4 | switch
    else:
        n_slow, slow = canfd.HEADER_BITS, (can_id << 5) | 4 | switch
    n_fast = canfd.DATA_HEADER_BITS + 8 * len(data)
    control = (16 if flags & ESI else 0) | canfd.length_code(len(data))
    bits = slow << n_fast | control << 8 * len(data) | int.from_bytes(data, "big")
    runs = _STUFFED.finditer(f"{bits:0{n_slow + n_fast}b}")
    stuffed = [k for run in runs for k in range(run.start() + 5, run.end() + 1, 4)]
    stuffed_slow = sum(k <= n_slow for k in stuffed)
    # after the last bit comes a fixed stuff bit
    stuffed_fast = sum(n_slow < k < n_slow + n_fast for k in stuffed)
    nominal = canfd.NOMINAL_BITS + n_slow - canfd.HEADER_BITS + stuffed_slow
    fast = n_fast + stuffed_fast + canfd.crc_bits(len(data))
    return canfd.PhaseBits(nominal, fast) if switch else canfd.PhaseBits(nominal + fast, 0)
