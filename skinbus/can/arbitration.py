"""Who wins the bus, and what CAN makes of two ports that send the same identifier at the same instant.

Arbitration cannot separate them. If the frames are equal to the last bit, nothing shows it and one frame
is on the wire. If not, the port that sends recessive where the other sends dominant detects a bit error and
destroys the frame with an error flag; both try again at once, and collide again. Each error adds 8 to the
error counter of both; beyond 127 a port is error passive: its flag is recessive and destroys nothing, so
the other frame gets through, and at last its own. Beyond 255 a port is bus-off and silent. Source: ISO
11898-1, 10.11 and 12.1 (fault confinement).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from skinbus.can.fd import length_code
from skinbus.can.frame import EXTENDED, FD, RTR, Frame

ERROR_PASSIVE: Final = 128
"""Transmit error counter from which a port is error passive."""

BUS_OFF: Final = 256
"""Transmit error counter from which a port is bus-off."""

ERROR_PENALTY: Final = 8
"""What one error adds to the transmit error counter."""

ERROR_FRAME_BITS: Final = 23
"""Two superposed error flags (12), error delimiter (8), interframe space (3): the longest error frame."""

_HEADER_BITS: Final = 19
_EXTENDED_HEADER_BITS: Final = 39


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a collision ends.

    sent    indices of the contenders whose (equal) frame gets through; empty if all were destroyed
    failed  indices of the contenders that saw an error and will try again
    bits    bit times lost until the bus is free again; 0 if a frame got through
    """

    sent: tuple[int, ...]
    failed: tuple[int, ...]
    bits: int


def collide(frames: Sequence[Frame], error_counters: Sequence[int]) -> Outcome:
    """How it ends when frames equal in arbitration are sent at once, given the error counters."""
    # Zero is dominant: of the bits after the identifier, the smallest in lexical order wins.
    bodies = [bytes([_control(frame)]) + (b"" if frame.flags & RTR else frame.data) for frame in frames]
    winner = min(bodies)
    losers = tuple(i for i, body in enumerate(bodies) if body != winner)
    if all(error_counters[i] >= ERROR_PASSIVE for i in losers):
        return Outcome(tuple(i for i, body in enumerate(bodies) if body == winner), losers, 0)
    # The first error flag comes where the first active loser differs; stuff bits before it are not counted.
    equal = min(_equal_bits(bodies[i], winner) for i in losers if error_counters[i] < ERROR_PASSIVE)
    before_data = _EXTENDED_HEADER_BITS if frames[0].flags & EXTENDED else _HEADER_BITS
    # The first byte of a body stands for the four bits of the length, the last of the header.
    return Outcome((), tuple(range(len(frames))), before_data + equal - 8 + 1 + ERROR_FRAME_BITS)


def _control(frame: Frame) -> int:
    """The bits between arbitration and data: the format (FD is recessive) and the length code."""
    return (0x10 if frame.flags & FD else 0) | length_code(len(frame.data))


def _equal_bits(a: bytes, b: bytes) -> int:
    """How many leading bits of a and b are equal."""
    for i, (x, y) in enumerate(zip(a, b, strict=False)):
        if x != y:
            return 8 * i + 8 - (x ^ y).bit_length()
    return 8 * min(len(a), len(b))


def arbitration_key(frame: Frame) -> int:
    """The bits of the arbitration field as a number: the lower one wins the bus."""
    can_id, _, _, flags, _ = frame
    if not flags:
        return can_id << 21
    remote = 1 if flags & RTR else 0
    if (
        flags & EXTENDED
    ):  # both SRR and IDE are recessive, so an extended frame loses against its base identifier
        return (can_id >> 18) << 21 | 3 << 19 | (can_id & 0x3FFFF) << 1 | remote
    return can_id << 21 | remote << 20
