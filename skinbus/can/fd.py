"""How long CAN FD frames are: the lengths there are, and the bits of their two phases at worst.

Everything up to the bit rate switch, and from the CRC delimiter on, is at the nominal bit rate; what lies
between is at the data bit rate. Source: ISO 11898-1:2015, 10.4.2 (lengths), 10.4.2.6 (CRC), 10.5 (stuffing).
"""

from __future__ import annotations

from bisect import bisect_left
from typing import NamedTuple

CLASSIC_BYTES = 8
"""Most bytes of a frame of classic CAN; longer ones are CAN FD frames."""
LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""Bytes of a frame by its length code."""
MAX_BYTES = LENGTHS[-1]

NOMINAL_BITS = 30
"""17 up to the switch of an 11-bit identifier, CRC delimiter, ACK slot and delimiter, 7 end, 3 interframe."""
HEADER_BITS = 17
"""Those of the first that are subject to bit stuffing."""
DATA_HEADER_BITS = 5
"""Error state and length code, at the data bit rate."""


class PhaseBits(NamedTuple):
    """Bits of a frame by the bit rate that they are sent at."""

    nominal: int
    data: int

    def ns(self, bitrate: int, data_bitrate: int) -> int:
        """Time on the wire, rounded up (ns)."""
        return -(-self.nominal * 1_000_000_000 // bitrate) - (-self.data * 1_000_000_000 // data_bitrate)


def length_code(n_bytes: int) -> int:
    """Return the smallest length code that holds so many bytes.

    Raises:
        ValueError: no frame is so long.
    """
    if not 0 <= n_bytes <= MAX_BYTES:
        raise ValueError(f"{n_bytes} bytes; wanted 0..{MAX_BYTES}")
    return bisect_left(LENGTHS, n_bytes)


def frame_length(n_bytes: int) -> int:
    """Return the bytes of the shortest frame that holds so many, what is left over being zero.

    What no frame holds is as long as it is.
    """
    return LENGTHS[length_code(n_bytes)] if n_bytes <= MAX_BYTES else n_bytes


def crc_bits(n_bytes: int) -> int:
    """Bits of stuff count (4) and CRC (17 or 21) of a frame, fixed stuff bits (one in five) among them."""
    return 27 if n_bytes <= 16 else 32


def worst_case_bits(n_bytes: int) -> PhaseBits:
    """Return the longest frame with an 11-bit identifier and so many bytes, whatever the two bit rates.

    One bit in four after the first is a stuff bit at worst; as many of them as can be are in the slow phase.
    """
    length = frame_length(n_bytes)
    stuffable = HEADER_BITS + DATA_HEADER_BITS + 8 * length
    slow = (HEADER_BITS - 1) // 4
    fast = (stuffable - 1) // 4 - slow
    return PhaseBits(NOMINAL_BITS + slow, DATA_HEADER_BITS + 8 * length + fast + crc_bits(length))
