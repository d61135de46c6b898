"""Many frames with one system call: a reader into, and a writer from, arrays that are allocated once."""

from __future__ import annotations

import ctypes
import os
import socket
import struct
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Bytes
from skinbus.can.clock import Clock
from skinbus.can.frame import (
    BRS,
    ERROR,
    ESI,
    EXTENDED,
    FD,
    FRAME_DTYPE,
    MAX_DATA,
    REMOTE_ID,
    RTR,
    Frame,
    FrameBatch,
    Frames,
)

CAN_MTU = 16
CANFD_MTU = 72
EFF_FLAG = 0x8000_0000
RTR_FLAG = 0x4000_0000
ERR_FLAG = 0x2000_0000
SFF_MASK = 0x7FF
EFF_MASK = 0x1FFF_FFFF
MAX_FILTERS = 512
"""CAN_RAW_FILTER_MAX: more are refused with EINVAL."""

CAN_RAW_ERR_FILTER = 2
SO_RCVBUFFORCE = 33
SO_TIMESTAMPNS = 35
SO_RXQ_OVFL = 40
MSG_DONTWAIT = 0x40

CONTROL_BYTES = 64
"""Room for one time stamp (32) and one drop counter (24), always in this order (sock_recv_cmsgs)."""

MESSAGE_DTYPE = np.dtype(
    [
        ("name", "<u8"),
        ("name_length", "<u8"),
        ("iov", "<u8"),
        ("n_iov", "<u8"),
        ("control", "<u8"),
        ("control_length", "<u8"),
        ("flags", "<u8"),
        ("length", "<u8"),
    ]
)
"""struct mmsghdr; the 32-bit fields are widened by their padding, which the kernel leaves zero."""

IOV_DTYPE = np.dtype([("base", "<u8"), ("length", "<u8")])

_libc = ctypes.CDLL(None, use_errno=True)
_libc.recvmmsg.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p]
_libc.sendmmsg.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int]


def exchange(call: Any, *args: int | None) -> int:
    """Call recvmmsg or sendmmsg; return how many messages came or went.

    Raises:
        OSError: not even the first.
    """
    n: int = call(*args)
    if n < 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
    return n


def address_of(array: npt.NDArray[Any]) -> int:
    """Address of an array's first element."""
    return int(array.__array_interface__["data"][0])


def headers(frames: npt.NDArray[Any], control: Bytes | None) -> tuple[Any, Any]:
    """Message headers and vectors that point into rows of frames and of control bytes."""
    n = len(frames)
    vectors = np.zeros(n, IOV_DTYPE)
    vectors["base"] = address_of(frames) + np.arange(n) * frames.itemsize
    vectors["length"] = CANFD_MTU
    messages = np.zeros(n, MESSAGE_DTYPE)
    messages["iov"] = address_of(vectors) + np.arange(n) * vectors.itemsize
    messages["n_iov"] = 1
    if control is not None:
        messages["control"] = address_of(control) + np.arange(n) * CONTROL_BYTES
        messages["control_length"] = CONTROL_BYTES
    return messages, vectors


def filters(cob_ids: Iterable[int] | None) -> bytes:
    """Value of CAN_RAW_FILTER for these identifiers (None: everything); larger ones than 0x7FF are 29-bit.

    One with ``REMOTE_ID`` lets remote frames pass. Single identifiers are found by the kernel in constant
    time. Where they are too many, whole function codes (11 bit) or all 29-bit frames pass, and the reader
    sorts out the rest.
    """
    if cob_ids is None:
        return struct.pack("<II", 0, 0)
    every = EFF_FLAG | RTR_FLAG
    remote = {(i & SFF_MASK | RTR_FLAG, SFF_MASK | every) for i in cob_ids if i & REMOTE_ID}
    data = sorted(i for i in cob_ids if not i & REMOTE_ID)
    pairs = [(i, SFF_MASK | every) if i <= SFF_MASK else (i | EFF_FLAG, EFF_MASK | every) for i in data]
    pairs += sorted(remote)
    if len(pairs) > MAX_FILTERS:
        coarse = {(i & 0x780, 0x780 | every) if i <= SFF_MASK else (EFF_FLAG, EFF_FLAG) for i in data}
        coarse |= {(i & ~0x7F, 0x780 | every) for i, _ in remote}
        pairs = sorted(coarse)
    return b"".join(struct.pack("<II", *pair) for pair in pairs)


def raise_receive_buffer(sock: socket.socket, size: int) -> None:
    """Ask for so many bytes of receive buffer."""
    for option in (SO_RCVBUFFORCE, socket.SO_RCVBUF):  # the first needs CAP_NET_ADMIN
        with suppress(PermissionError):
            sock.setsockopt(socket.SOL_SOCKET, option, size)
            return


def finish(
    can_id: Any,
    length: Any,
    flags: Any,
    bus: Any,
    t_ns: Any,
    messages: Any,
    control: Any,
    n: Any,
    offset_ns: Any,
    last_ns: Any,
    dropped: Any,
) -> Any:
    """Turn what the kernel wrote into frames of ours: identifiers without flags, flags, stamps on our clock.

    Each of n messages fills a row. Stamps never go back, and never beyond ``last_ns[1]``, the time now.
    The headers are made ready for the next call. Returns the kernel's drop counter, as last seen.
    """
    for i in range(n):
        raw = can_id[i]
        mark = 0
        if raw & ERR_FLAG:
            mark = ERROR
            can_id[i] = raw & EFF_MASK
        elif raw & EFF_FLAG:
            mark = EXTENDED
            can_id[i] = raw & EFF_MASK
        else:
            can_id[i] = raw & SFF_MASK
        if raw & RTR_FLAG:
            mark |= RTR
        if messages[i, 7] == CANFD_MTU:
            mark |= FD
            if flags[i] & 1:
                mark |= BRS
            if flags[i] & 2:
                mark |= ESI
            length[i] = min(length[i], 64)
        else:
            length[i] = min(length[i], 8)
        flags[i] = mark
        bus[i] = 0  # what the sender left in the kernel's reserved byte
        written = messages[i, 5]
        stamp = last_ns[1]
        if written >= 32 and control[i, 1] == (np.int64(SO_TIMESTAMPNS) << 32) | 1:
            stamp = min(control[i, 2] * 1_000_000_000 + control[i, 3] + offset_ns, stamp)
            if written >= 52 and control[i, 5] == (np.int64(SO_RXQ_OVFL) << 32) | 1:
                dropped = control[i, 6] & 0xFFFF_FFFF
        last_ns[0] = max(last_ns[0], stamp)
        t_ns[i] = last_ns[0]
        messages[i, 5] = CONTROL_BYTES
        messages[i, 6] = 0
    return dropped


@cache
def finish_kernel() -> Callable[..., Any]:
    """Return ``finish``, compiled."""
    from skinbus.jit import kernel  # numba: a core without a data plane does without

    return kernel(finish)


MAX_FRAMES = 1024
"""Frames of a system call: the kernel takes no more (UIO_MAXIOV), and a babbling node cannot hold it."""
CHUNK = 256
"""Frames that are sent by one."""

_FRAME = struct.Struct("<IBB2x64s")


class BatchReader:
    """Reads a raw CAN socket into a ``FrameBatch``; stamps are the kernel's, moved to our clock."""

    def __init__(
        self, sock: socket.socket, clock: Clock, capacity: int, finish_rows: Callable[..., Any] = finish
    ) -> None:
        """``finish_rows``: what ``finish_kernel`` returns, where many frames come: 2 us less for each."""
        self._finish_rows = finish_rows
        self.batch = FrameBatch(capacity)
        self.n_dropped = 0
        """Frames the kernel had no room for since the socket was opened."""
        self._fd = sock.fileno()
        self._clock = clock
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        sock.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        frames = self.batch.frames
        self._control = np.zeros((capacity, CONTROL_BYTES // 8), np.int64)
        self._messages, self._vectors = headers(frames, self._control.view(np.uint8))
        self._words = self._messages.view(np.int64).reshape(capacity, -1)
        self._address = address_of(self._messages)
        self._last_ns = np.zeros(2, np.int64)
        self._columns = frames["can_id"], frames["length"], frames["flags"], frames["bus"]
        self._finish(0)  # compiled now, not when frames wait

    def read(self) -> int:
        """Read all that is there, as far as the batch has room; how many. The batch holds only these.

        Raises:
            OSError: the interface is down or gone.
        """
        batch = self.batch
        batch.n = 0
        try:
            n = exchange(_libc.recvmmsg, self._fd, self._address, len(batch.frames), MSG_DONTWAIT, None)
        except (BlockingIOError, InterruptedError):
            return 0
        self._finish(n)
        batch.n = n
        return n

    def _finish(self, n: int) -> None:
        """Turn the n messages that were received into frames of ours."""
        now_ns = self._last_ns[1] = self._clock.now_ns()
        messages = self._words, self._control, n, now_ns - time.time_ns()
        columns = *self._columns, self.batch.t_ns
        self.n_dropped = int(self._finish_rows(*columns, *messages, self._last_ns, self.n_dropped))


class BatchWriter:
    """Writes frames to a raw CAN socket, up to ``CHUNK`` per system call."""

    def __init__(self, sock: socket.socket) -> None:
        self._fd = sock.fileno()
        self._memory = bytearray(CHUNK * CANFD_MTU)
        rows = np.frombuffer(self._memory, FRAME_DTYPE)
        self._messages, self._vectors = headers(rows, None)
        self._address = address_of(self._messages)
        self._lengths = np.zeros(CHUNK, np.uint64)

    def write(self, frames: Frames) -> int:
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
        return exchange(_libc.sendmmsg, self._fd, self._address, n, MSG_DONTWAIT)


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
