"""How long a CAN FD frame is on the wire: exact bits of both phases, with stuffing.

The fields up to the last byte of data are stuffed as in classic CAN; stuff count and CRC have stuff bits at
fixed places, the first of which stands for one that the data might have called for. Source: ISO
11898-1:2015, 10.4 and 10.5. What is sent at which bit rate is in ``model.canfd``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skinbus.can import fd as canfd
from skinbus.can.classic_bits import classic_fault, frame_bits
from skinbus.can.frame import BRS, ESI, EXTENDED, FD, Frame
from skinbus.jit import kernel


def fd_fault(frame: Frame) -> str:
    """Why CAN FD cannot carry the frame, classic frames among them; empty if it can."""
    if frame.flags & FD and len(frame.data) in canfd.LENGTHS:
        return classic_fault(frame._replace(data=b"", flags=frame.flags & ~FD))
    return "no length of CAN FD" if frame.flags & FD else classic_fault(frame)


def fd_bits(frame: Frame) -> canfd.PhaseBits:
    """Return the bits of an FD frame that can be carried; without the switch (BRS) all are nominal."""
    can_id, data, _, flags, _ = frame
    n = len(data)
    switch = 1 if flags & BRS else 0
    if flags & EXTENDED:
        n_slow = canfd.HEADER_BITS + canfd.EXTENDED_BITS
        slow = ((can_id >> 18) << 24) | (3 << 22) | ((can_id & 0x3FFFF) << 4) | 4 | switch
    else:
        n_slow = canfd.HEADER_BITS
        slow = (can_id << 5) | 4 | switch
    # The header as one number, first bit uppermost: start of frame is a zero, FDF the recessive one before
    # a reserved zero and the switch; error state and length code follow.
    header = (slow << canfd.DATA_HEADER_BITS) | (16 if flags & ESI else 0) | canfd.length_code(n)
    stuffed_slow, stuffed_fast = _stuffed(
        header, n_slow, n_slow + canfd.DATA_HEADER_BITS, np.frombuffer(data, np.uint8)
    )
    nominal = canfd.NOMINAL_BITS + n_slow - canfd.HEADER_BITS + int(stuffed_slow)
    fast = canfd.DATA_HEADER_BITS + 8 * n + int(stuffed_fast) + canfd.crc_bits(n)
    return canfd.PhaseBits(nominal, fast) if switch else canfd.PhaseBits(nominal + fast, 0)


def frame_ns(frame: Frame, bitrate: int, data_bitrate: int | None) -> int:
    """Time that a frame takes on a bus of these bit rates, interframe space included (ns).

    Raises:
        ValueError: the bus cannot carry it.
    """
    if not frame.flags & FD:
        return -(-frame_bits(frame) * 1_000_000_000 // bitrate)
    if fault := fd_fault(frame) if data_bitrate else "CAN FD on a classic bus":
        raise ValueError(f"{fault}: {frame}")
    return fd_bits(frame).ns(bitrate, data_bitrate or bitrate)


@kernel
def _stuffed(header: Any, n_slow: Any, n_header: Any, data: Any) -> Any:
    """Stuff bits up to the switch of the bit rate, and after it."""
    slow = fast = run = 0
    last = -1
    n = n_header + 8 * len(data)
    for i in range(n):
        if i < n_header:
            bit = (header >> (n_header - 1 - i)) & 1
        else:
            k = i - n_header
            bit = (np.int64(data[k >> 3]) >> (7 - (k & 7))) & 1
        if bit == last:
            run += 1
        else:
            last = bit
            run = 1
        if run == 5 and i < n - 1:  # after the last bit comes a fixed stuff bit
            if i < n_slow:
                slow += 1
            else:
                fast += 1
            last = 1 - bit
            run = 1
    return slow, fast
