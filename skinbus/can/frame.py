"""CAN frames: one as a tuple for the control plane, many as flat columns for the data plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

EXTENDED = 0x1
RTR = 0x2
ERROR = 0x4
FD = 0x8
BRS = 0x10
ESI = 0x20
"""Flags of a frame; a plain classic data frame with an 11-bit identifier has none. BRS and ESI go with FD."""

NO_DATA = RTR | ERROR
"""Flags of frames that are not data frames, of which there is one at most."""

MAX_DATA = 64
"""Bytes a frame can carry (CAN FD); classic CAN carries 8."""


REMOTE_ID = 1 << 30
"""Added to an 11-bit identifier that a core listens to: remote frames with it, which no other gets."""

LONG = FD | BRS
"""Flags of the frames that we send with more bytes than classic CAN carries."""


class Frame(NamedTuple):
    """One CAN frame: identifier, data bytes, time of its last bit (ns), flags, and which bus it is on.

    Buses are numbered from 0 by whoever is on several of them.
    Of a remote frame only the length of ``data`` counts: it is the length that is asked for.
    """

    can_id: int
    data: bytes = b""
    t_ns: int = 0
    flags: int = 0
    bus: int = 0


Frames = Sequence[Frame]
CobIds = frozenset[int]
"""Identifiers; see ``core.receives``."""

FRAME_DTYPE = np.dtype(
    [
        ("can_id", "<u4"),
        ("length", "u1"),
        ("flags", "u1"),
        ("bus", "u1"),
        ("pad", "u1"),
        ("data", "u1", (MAX_DATA,)),
    ]
)
"""Layout of the kernel's ``struct canfd_frame``; a classic ``struct can_frame`` is its first 16 bytes.

The bus is ours: it is in a byte that the kernel reserves.
"""


class FrameBatch:
    """A preallocated block of frames with their times; ``n`` of ``capacity`` are in use."""

    __slots__ = ("frames", "n", "t_ns")

    def __init__(self, capacity: int) -> None:
        self.frames: npt.NDArray[Any] = np.zeros(capacity, FRAME_DTYPE)
        self.t_ns = np.zeros(capacity, np.int64)
        self.n = 0

    def drop(self, n: int) -> None:
        """Discard the first n frames."""
        left = max(self.n - n, 0)
        self.frames[:left] = self.frames[n : n + left].copy()
        self.t_ns[:left] = self.t_ns[n : n + left].copy()
        self.n = left

    def extend(self, frames: Frames) -> None:
        """Add frames, for which there is room, in bulk."""
        n = len(frames)
        if n == 0:
            return
        rows = self.frames[self.n : self.n + n]
        can_id, data, t_ns, flags, bus = zip(*frames, strict=True)
        rows["can_id"], rows["flags"], rows["bus"] = can_id, flags, bus
        rows["length"] = [len(d) for d in data]
        width = max(1, *map(len, data))
        padded = b"".join(d.ljust(width, b"\0") for d in data)
        rows["data"][:, :width] = np.frombuffer(padded, np.uint8).reshape(n, width)
        self.t_ns[self.n : self.n + n] = t_ns
        self.n += n
