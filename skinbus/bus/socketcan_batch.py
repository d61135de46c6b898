"""Many frames with one system call: a reader into, and a writer from, arrays that are allocated once."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Sequence
from typing import Final

import numpy as np

from skinbus.bus.socketcan_abi import (
    CAN_MTU,
    CANFD_MTU,
    CONTROL_BYTES,
    EFF_FLAG,
    RTR_FLAG,
    address_of,
    finish,
    headers,
    receive_messages,
    send_messages,
    set_timestamps,
)
from skinbus.can.clock import Clock
from skinbus.can.frame import BRS, ESI, EXTENDED, FD, FRAME_DTYPE, MAX_DATA, RTR, Frame, FrameBatch

CHUNK: Final = 256
"""Frames per system call: beyond that the time per frame no longer falls."""

_FRAME: Final = struct.Struct("<IBB2x64s")


class BatchReader:
    """Reads a raw CAN socket into a ``FrameBatch``; stamps are the kernel's, moved to our clock."""

    def __init__(self, sock: socket.socket, clock: Clock, capacity: int) -> None:
        self.batch = FrameBatch(capacity)
        self.n_dropped = 0
        """Frames the kernel had no room for since the socket was opened."""
        self._fd = sock.fileno()
        self._clock = clock
        set_timestamps(sock)
        self._chunk = min(CHUNK, capacity)
        self._control = np.zeros((self._chunk, CONTROL_BYTES // 8), np.int64)
        self._messages, self._vectors = headers(
            np.zeros(self._chunk, FRAME_DTYPE), self._control.view(np.uint8)
        )
        self._words = self._messages.view(np.int64).reshape(self._chunk, -1)
        self._rows = np.arange(self._chunk, dtype=np.uint64) * FRAME_DTYPE.itemsize
        self._pointed = -1
        self._address = address_of(self._messages)
        self._last_ns = np.zeros(2, np.int64)
        frames = self.batch.frames
        self._columns = frames["can_id"], frames["length"], frames["flags"], frames["bus"]
        self._finish(0, 0)  # compiled now, not when frames wait

    def read(self) -> int:
        """Read all that is there, as far as the batch has room; how many. The batch holds only these.

        Raises:
            OSError: the interface is down or gone.
        """
        batch = self.batch
        batch.n = 0
        while batch.n < len(batch.frames):
            room = min(self._chunk, len(batch.frames) - batch.n)
            self._point(batch.n)
            n = receive_messages(self._fd, self._address, room)
            if n == 0:
                break
            self._finish(batch.n, n)
            batch.n += n
            if n < room:
                break
        return batch.n

    def _finish(self, first: int, n: int) -> None:
        """Turn the n messages that were received into frames of ours, from row ``first`` on."""
        now_ns = self._last_ns[1] = self._clock.now_ns()
        self.n_dropped = int(
            finish(
                *self._columns,
                self.batch.t_ns,
                self._words,
                self._control,
                first,
                n,
                now_ns - time.time_ns(),
                self._last_ns,
                self.n_dropped,
            )
        )

    def _point(self, first: int) -> None:
        """Let the messages fill the batch from row ``first`` on."""
        if first != self._pointed:
            self._vectors["base"] = address_of(self.batch.frames) + first * FRAME_DTYPE.itemsize + self._rows
            self._pointed = first


class BatchWriter:
    """Writes frames to a raw CAN socket, up to ``CHUNK`` per system call."""

    def __init__(self, sock: socket.socket) -> None:
        self._fd = sock.fileno()
        self._memory = bytearray(CHUNK * CANFD_MTU)
        rows = np.frombuffer(self._memory, FRAME_DTYPE)
        self._messages, self._vectors = headers(rows, None)
        self._address = address_of(self._messages)
        self._lengths = np.zeros(CHUNK, np.uint64)

    def write(self, frames: Sequence[Frame]) -> int:
        """Send at most ``CHUNK`` frames, all of which are fit to be sent; how many went out.

        Raises:
            OSError: not even the first could be sent; the number says why.
        """
        n = min(len(frames), CHUNK)
        for i in range(n):
            frame = frames[i]
            _FRAME.pack_into(self._memory, i * CANFD_MTU, *to_kernel(frame))
            self._lengths[i] = CANFD_MTU if frame.flags & FD else CAN_MTU
        self._vectors["length"][:n] = self._lengths[:n]
        return send_messages(self._fd, self._address, n)


def to_kernel(frame: Frame) -> tuple[int, int, int, bytes]:
    """Fields of struct canfd_frame: identifier with flags, length, FD flags, data."""
    can_id, data, _, flags, _ = frame
    if flags:
        if flags & EXTENDED:
            can_id |= EFF_FLAG
        if flags & RTR:
            return can_id | RTR_FLAG, len(data), 0, b""
        return can_id, len(data), bool(flags & BRS) | bool(flags & ESI) << 1, data
    return can_id, len(data), 0, data


def to_frames(batch: FrameBatch) -> list[Frame]:
    """The frames of a batch one by one."""
    raw = batch.frames[: batch.n].tobytes()
    return [
        Frame(can_id, data[: min(length, MAX_DATA)], t_ns, flags)
        for (can_id, length, flags, data), t_ns in zip(
            _FRAME.iter_unpack(raw), batch.t_ns[: batch.n].tolist(), strict=True
        )
    ]
