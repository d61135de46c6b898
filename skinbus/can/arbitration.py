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

from skinbus.can.frame import EXTENDED, FD, RTR, Frame, Frames

ERROR_PASSIVE = 128
"""Transmit error counter from which a port is error passive."""

BUS_OFF = 256
"""Transmit error counter from which a port is bus-off."""

ERROR_PENALTY = 8
"""What one error adds to the transmit error counter."""

COLLISION_BITS = 50
"""Lost by a collision: the header (19), some bits until the frames differ, and an error frame (23)."""


def collide(frames: Frames, error_counters: Sequence[int]) -> tuple[list[int], list[int], int]:
    """Return how it ends when frames equal in arbitration are sent at once, given the error counters.

    The first are the numbers of those whose (equal) frame gets through, none if all were destroyed; the
    others see an error and will try again. The last are the bit times lost if all were destroyed.
    """
    # Zero is dominant, FD recessive: of the bits after the identifier, the smallest in lexical order wins.
    bodies = [
        (frame.flags & FD, len(frame.data), b"" if frame.flags & RTR else frame.data) for frame in frames
    ]
    winner = min(bodies)
    losers = [i for i, body in enumerate(bodies) if body != winner]
    if all(error_counters[i] >= ERROR_PASSIVE for i in losers):
        return [i for i, body in enumerate(bodies) if body == winner], losers, 0
    return [], list(range(len(frames))), COLLISION_BITS


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
