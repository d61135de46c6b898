"""A bus of UDP datagrams for development: on the loopback by default, datagrams are checked.

The format is that of python-can's ``udp_multicast``, so its users can be on the same group. Anybody who
reaches the group can send: a datagram is dropped by size before it is unpacked, and by the types and lengths
of what it holds before anything is made of it. python-can's own reader allocates what a datagram asks for
(``data: 2**32``: 4.2 GB), and listens on all networks, to datagrams for this machine alone, too.
"""

from __future__ import annotations

import errno
import logging
import select
import socket
import struct
import sys
from functools import cache
from typing import Any

import can

try:
    import msgpack
except ImportError:  # only this interface needs it
    msgpack = None

PORT = 43113
"""python-can's."""

MAX_DATAGRAM = 512
"""Bytes; a frame of 64 bytes with all its keys has 290."""

MAX_DATA = 64
MAX_TEXT = 64
_FLAGS = (
    *("is_extended_id", "is_remote_frame", "is_error_frame", "is_fd"),
    *("bitrate_switch", "error_state_indicator"),
)
_SO_TIMESTAMPNS = 35  # asm-generic/socket.h
_STAMP = struct.Struct("@ll")
_MULTICAST_ALL = 49  # linux/in.h; not in Python's socket module
_LOOPBACK = "lo" if sys.platform == "linux" else "lo0"


@cache
def _warn() -> None:
    """Log once in a process what this bus is for."""
    text = "udp_multicast is for development: it keeps no times, and whoever reaches it can command"
    logging.getLogger(__name__).warning(text)


def unpack_datagram(datagram: bytes) -> dict[str, Any] | None:
    """Return what a datagram says of a frame, as arguments of ``can.Message``; None if it is no frame."""
    if len(datagram) > MAX_DATAGRAM:
        return None
    try:
        fields = msgpack.unpackb(datagram, raw=False)
    except Exception:  # noqa: BLE001 - msgpack has many, and a datagram is untrusted
        return None
    if not isinstance(fields, dict):
        return None
    can_id, dlc, data = (fields.get(key) for key in ("arbitration_id", "dlc", "data"))
    flags = {key: fields.get(key, False) for key in _FLAGS}
    channel = fields.get("channel")
    data = b"" if data is None else data
    if not type(can_id) is type(dlc) is int or not isinstance(data, bytes):
        return None
    is_long = flags["is_extended_id"] or flags["is_error_frame"]
    fits = (
        0 <= can_id < 1 << (29 if is_long else 11)
        and dlc >= 0
        and len(data) <= (MAX_DATA if flags["is_fd"] else 8)
        and all(type(flag) is bool for flag in flags.values())
        and (channel is None or (isinstance(channel, str) and len(channel) <= MAX_TEXT))
    )
    if not fits or (bool(data) or dlc > 8 if flags["is_remote_frame"] else dlc != len(data)):
        return None
    return {"arbitration_id": can_id, "dlc": dlc, "data": data, "channel": channel, **flags}


def pack_datagram(message: can.Message) -> bytes:
    """Return a message as a datagram."""
    keys = ("timestamp", "arbitration_id", "channel", "dlc", "data", *_FLAGS)
    packed: bytes = msgpack.packb({key: getattr(message, key) for key in keys}, use_bin_type=True)
    return packed


class MulticastBus(can.BusABC):
    """One multicast group of IPv4 on one network interface; ``channel`` is GROUP or GROUP@INTERFACE."""

    def __init__(self, channel: str, *, port: int = PORT, fd: bool = False) -> None:
        """Join the group.

        Raises:
            can.CanInterfaceNotImplementedError: there is no msgpack.
            OSError: it is no multicast group, or the interface does not exist.
        """
        if msgpack is None:
            raise can.CanInterfaceNotImplementedError("msgpack not installed")
        super().__init__(channel)
        _warn()
        self._fd = fd
        group, _, name = channel.partition("@")
        try:
            index = socket.if_nametoindex(name or _LOOPBACK)
        except OSError:
            raise OSError(errno.ENODEV, f"no network interface {name}") from None
        hops = 1 if name else 0  # none: a datagram stays on this machine
        try:
            member = socket.inet_pton(socket.AF_INET, group)
            if member[0] >> 4 != 0xE:  # 224.0.0.0/4
                raise OSError
        except OSError:
            raise OSError(errno.EINVAL, f"{group} is no multicast group of IPv4") from None
        self._address = group, port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            for option in (socket.SO_REUSEADDR, socket.SO_REUSEPORT):
                self._socket.setsockopt(socket.SOL_SOCKET, option, 1)
            # Bound to the group, not to all addresses: unicast datagrams are not received.
            self._socket.bind(self._address)
            if sys.platform == "linux":
                self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
                # Nor are those that another process here has its group's networks deliver.
                self._socket.setsockopt(socket.IPPROTO_IP, _MULTICAST_ALL, 0)
            there = struct.pack("@4s4si", bytes(4), bytes(4), index)
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, there)
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, hops)
            request = struct.pack("@4s4si", member, bytes(4), index)
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, request)
        except OSError:
            self._socket.close()
            raise

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            if not select.select([self._socket], [], [], timeout)[0]:
                return None, False
            datagram, extra, _, _ = self._socket.recvmsg(MAX_DATAGRAM + 1, socket.CMSG_SPACE(_STAMP.size))
        except OSError as error:
            raise can.CanOperationError(str(error), error.errno) from error
        fields = unpack_datagram(datagram)
        if fields is None:
            raise can.CanOperationError("a datagram that is no frame")
        if fields["is_fd"] and not self._fd:
            return None, False
        seconds = 0.0
        for level, kind, data in extra:
            if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS):
                s, ns = _STAMP.unpack(data[: _STAMP.size])
                seconds = s + 1e-9 * ns
        return can.Message(timestamp=seconds, **fields), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one message to the group."""
        try:
            self._socket.sendto(pack_datagram(msg), socket.MSG_DONTWAIT, self._address)
        except OSError as error:
            raise can.CanOperationError(str(error), error.errno or errno.EIO) from error

    def fileno(self) -> int:
        """Return the descriptor of the socket."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Leave the group."""
        super().shutdown()
        self._socket.close()
