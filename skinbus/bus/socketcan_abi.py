"""The kernel's side of SocketCAN: headers for recvmmsg and sendmmsg, filters, numbers of error frames.

Layouts are those of 64-bit Linux (linux/can.h, linux/can/raw.h, linux/can/error.h, bits/socket.h).
"""

from __future__ import annotations

import ctypes
import os
import socket
import struct
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, REMOTE_ID, RTR
from skinbus.jit import kernel

CAN_MTU: Final = 16
CANFD_MTU: Final = 72
EFF_FLAG: Final = 0x8000_0000
RTR_FLAG: Final = 0x4000_0000
ERR_FLAG: Final = 0x2000_0000
SFF_MASK: Final = 0x7FF
EFF_MASK: Final = 0x1FFF_FFFF
MAX_FILTERS: Final = 512
"""CAN_RAW_FILTER_MAX: more are refused with EINVAL."""

CAN_RAW_ERR_FILTER: Final = 2
SO_RCVBUFFORCE: Final = 33
SO_TIMESTAMPNS: Final = 35
SO_RXQ_OVFL: Final = 40
MSG_DONTWAIT: Final = 0x40

CONTROL_BYTES: Final = 64
"""Room for one time stamp (32) and one drop counter (24), always in this order (sock_recv_cmsgs)."""

MESSAGE_DTYPE: Final = np.dtype(
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

IOV_DTYPE: Final = np.dtype([("base", "<u8"), ("length", "<u8")])

_libc = ctypes.CDLL(None, use_errno=True)
_libc.recvmmsg.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p]
_libc.sendmmsg.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int]


def receive_messages(fd: int, address: int, n: int) -> int:
    """Receive up to n messages into the headers at an address; 0 when none is there, else OSError."""
    got: int = _libc.recvmmsg(fd, address, n, MSG_DONTWAIT, None)
    if got >= 0:
        return got
    code = ctypes.get_errno()
    if code in (11, 4):  # EAGAIN, EINTR
        return 0
    raise OSError(code, os.strerror(code))


def send_messages(fd: int, address: int, n: int) -> int:
    """Send n messages from the headers at an address; how many went out, OSError if not even the first."""
    sent: int = _libc.sendmmsg(fd, address, n, MSG_DONTWAIT)
    if sent >= 0:
        return sent
    code = ctypes.get_errno()
    raise OSError(code, os.strerror(code))


def address_of(array: npt.NDArray[Any]) -> int:
    """Address of an array's first element."""
    return int(array.__array_interface__["data"][0])


def headers(frames: npt.NDArray[Any], control: npt.NDArray[np.uint8] | None) -> tuple[Any, Any]:
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


def set_timestamps(sock: socket.socket) -> None:
    """Let every frame bring its time of reception and, after a loss, the count of frames lost."""
    sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    sock.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)


def raise_receive_buffer(sock: socket.socket, size: int) -> int:
    """Ask for so many bytes of receive buffer; what was reached."""
    for option in (SO_RCVBUFFORCE, socket.SO_RCVBUF):  # the first needs CAP_NET_ADMIN
        try:
            sock.setsockopt(socket.SOL_SOCKET, option, size)
            break
        except PermissionError:
            continue
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


@kernel
def finish(
    can_id: Any,
    length: Any,
    flags: Any,
    bus: Any,
    t_ns: Any,
    messages: Any,
    control: Any,
    first: Any,
    n: Any,
    offset_ns: Any,
    last_ns: Any,
    dropped: Any,
) -> Any:
    """Turn what the kernel wrote into frames of ours: identifiers without flags, flags, stamps on our clock.

    Message k of n fills row first + k. Stamps never go back, and never beyond ``last_ns[1]``, the time now.
    The headers are made ready for the next call. Returns the kernel's drop counter, as last seen.
    """
    for k in range(n):
        i = first + k
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
        if messages[k, 7] == CANFD_MTU:
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
        written = messages[k, 5]
        stamp = last_ns[1]
        if written >= 32 and control[k, 1] == (np.int64(SO_TIMESTAMPNS) << 32) | 1:
            stamp = min(control[k, 2] * 1_000_000_000 + control[k, 3] + offset_ns, stamp)
            if written >= 52 and control[k, 5] == (np.int64(SO_RXQ_OVFL) << 32) | 1:
                dropped = control[k, 6] & 0xFFFF_FFFF
        last_ns[0] = max(last_ns[0], stamp)
        t_ns[i] = last_ns[0]
        messages[k, 5] = CONTROL_BYTES
        messages[k, 6] = 0
    return dropped
