"""How long a classic CAN frame can be on the wire: its fields, and the worst that stuffing makes of them."""

from __future__ import annotations

MAX_DATA = 8
HEADER_BITS = 19  # start, 11 identifier, RTR, IDE, r0, 4 length
EXTENDED_HEADER_BITS = 39  # start, 11 identifier, SRR, IDE, 18 identifier, RTR, r1, r0, 4 length
CRC_BITS = 15
END_BITS = 10
"""CRC delimiter, ACK slot, ACK delimiter and end of frame; never stuffed."""
INTERFRAME_BITS = 3


def worst_case_bits(length: int) -> int:
    """Bit times of a data frame with 11-bit identifier and ``length`` bytes and as many stuff bits as can be.

    Source: Davis, Burns, Bril, Lukkien, "Controller Area Network schedulability analysis", 2007, eq. 1-2.
    """
    if not 0 <= length <= MAX_DATA:
        raise ValueError(f"length is {length}; wanted 0..{MAX_DATA}")
    stuffable = HEADER_BITS + 8 * length + CRC_BITS
    return stuffable + (stuffable - 1) // 4 + END_BITS + INTERFRAME_BITS
