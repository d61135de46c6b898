"""An interface by its python-can name: frames in and out, without blocking or ending by a fault.

python-can leaves to its users what is done here: the echo of one's own frames on ``udp_multicast`` is
dropped; the socket's receive buffer is raised (a burst of 504 frames overruns the default), one garbage
datagram does not end reception, a full send buffer is waited for with a limit, and errors name a remedy.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import secrets
import socket
import time
from collections.abc import Mapping
from typing import Any

import can

from skinbus.bus.interface import BAD_FRAME, RETRY_S, SEND_PATIENCE_S, Bus, advice
from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.bus.socketcan_batch import raise_receive_buffer
from skinbus.bus.udp_multicast import MulticastBus
from skinbus.can.core import receives
from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, MAX_DATA, RTR, CobIds, Frame, FrameBatch, Frames
from skinbus.errors import BusError

DEFAULT_INTERFACE = "socketcan"
DEFAULT_CHANNELS: Mapping[str, str] = {
    "socketcan": "can0",
    "udp_multicast": "239.74.163.2",  # python-can's IPv4 group; many containers lack IPv6, its default
    "virtual": "skinbus",
}

RECEIVE_BUFFER = 4 << 20
"""Bytes of socket buffer that are asked for: about 5000 frames, half a second of a full bus."""

MAX_BATCH = 2048
"""Frames that one ``receive`` returns at most, so that a babbling node cannot hold it."""

_STALE_NS = (
    60_000_000_000  # a stamp this far from now is not on the Unix clock (hardware counts from power-up)
)
_FULL = {errno.ENOBUFS, errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR, errno.ENOMEM}

# python-can logs errors besides raising them; its log is shown only where logging is configured.
logging.getLogger("can").addHandler(logging.NullHandler())


class PythonCanBus(Bus):
    """An open interface; raises BusError when the bus is gone."""

    def __init__(
        self,
        interface: str,
        channel: str | None,
        *,
        bitrate: int | None = None,
        fd: bool = False,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Open it.

        interface  python-can's name: socketcan, virtual, udp_multicast, slcan, pcan, kvaser, ...
        channel    in the form that interface takes; None for the usual one
        bitrate    for interfaces that set it themselves; socketcan takes it from ``ip link``
        fd         whether CAN FD frames may be sent and are received
        options    further settings for python-can's interface
        Raises BusError that says what to do about it.
        """
        self.interface = interface
        self.channel = DEFAULT_CHANNELS.get(interface) if channel is None else channel
        self.fd = fd
        self.clock = MonotonicClock()
        self.batch = FrameBatch(1)
        self._data_ids: CobIds = frozenset()
        self._tag = secrets.token_hex(4) if interface == "udp_multicast" else None
        self._last_ns = self.clock.now_ns()
        self._buffer_stuck = False
        sets_bitrate = bitrate is not None and interface != "udp_multicast"
        settings: dict[str, Any] = {"bitrate": bitrate} if sets_bitrate else {}
        if fd and interface != "virtual":
            settings["fd"] = True
        self._bus = self._open(settings | dict(options or {}))
        _raise_receive_buffer(self._bus)

    def listen(self, cob_ids: CobIds | None, data_ids: CobIds = frozenset()) -> None:
        """Receive ``data_ids`` into the batch; of the others python-can passes on all."""
        self._data_ids = data_ids
        if data_ids and len(self.batch.frames) < MAX_BATCH:
            self.batch = FrameBatch(MAX_BATCH)

    def receive(self, timeout_s: float = 0.0) -> list[Frame]:
        """All frames that are there, those of the data plane in ``batch``; waits ``timeout_s`` for the first.

        Raises BusError if the interface is down or gone.
        """
        self.batch.n = 0
        messages: list[can.Message] = []
        while len(messages) < MAX_BATCH and (message := self._receive_one(timeout_s)) is not None:
            messages.append(message)
            timeout_s = 0.0
        if not messages:
            return []
        now_ns, unix_ns = self.clock.now_ns(), time.time_ns()
        frames = [
            _to_frame(message, self._stamp(message.timestamp, now_ns, unix_ns))
            for message in messages
            if self._tag is None or message.channel != self._tag
        ]
        if self._data_ids:
            self.batch.extend([frame for frame in frames if receives(self._data_ids, frame)])
            frames = [frame for frame in frames if not receives(self._data_ids, frame)]
        return frames

    def send(self, frames: Frames) -> int:
        """Send frames in this order; returns how many were sent.

        Raises BusError if the interface is down or gone.
        """
        return sum(self._send_one(_to_message(frame, self._tag)) for frame in frames if self.fits(frame))

    def descriptors(self, *, for_data: bool = True) -> list[int]:
        """Descriptors that become readable with frames; none if there are none."""
        try:
            fd = self._bus.fileno()
        except NotImplementedError:
            return []
        return [fd] if fd >= 0 else []

    def close(self) -> None:
        """Let go of the interface; a second call does nothing. BusError when the library fails at it."""
        try:
            self._bus.shutdown()
        except Exception as error:  # each library has errors of its own
            raise BusError(f"{self}: closing failed: {error}") from error

    def _receive_one(self, timeout_s: float) -> can.Message | None:
        for _ in range(MAX_BATCH):  # a storm of garbage ends the call, too
            try:
                return self._bus.recv(timeout_s)
            except (can.CanError, OSError, ValueError) as error:
                # Anybody may send datagrams to a multicast group; elsewhere any error is the bus's.
                if self._tag is None or _errno(error) is not None or isinstance(error, ValueError):
                    raise BusError(f"{self}: reception ended: {error}") from error
                timeout_s = 0.0
        return None

    def _send_one(self, message: can.Message) -> bool:
        """Return whether it was sent; a full buffer is waited for, but no longer once that was in vain."""
        patience_s = 0.0 if self._buffer_stuck else SEND_PATIENCE_S
        give_up_s = time.monotonic() + patience_s
        while True:
            try:
                self._bus.send(message, timeout=patience_s)
            except (can.CanError, OSError, ValueError) as error:
                code = _errno(error)
                if code in BAD_FRAME:
                    return False
                if code is not None and code not in _FULL:
                    raise BusError(f"{self}: sending failed: {error}") from error
                if code is None and not _is_full(error):
                    return False  # some receiver on the virtual bus has a full queue
                if time.monotonic() >= give_up_s:
                    self._buffer_stuck = True
                    return False
                time.sleep(RETRY_S)
            else:
                self._buffer_stuck = False
                return True

    def _stamp(self, timestamp: float, now_ns: int, unix_ns: int) -> int:
        """The message's time on our clock: never in the future, never before an earlier message."""
        age_ns = unix_ns - int(timestamp * 1e9)
        t_ns = now_ns - age_ns if 0 <= age_ns < _STALE_NS else now_ns
        self._last_ns = max(self._last_ns, t_ns)
        return self._last_ns

    def __str__(self) -> str:
        return f"{self.interface} {self.channel}" if self.channel else self.interface

    def _open(self, settings: Mapping[str, Any]) -> can.BusABC:
        """The opened interface, or a BusError with advice."""
        try:
            if self.interface == "udp_multicast":
                return MulticastBus(self.channel or DEFAULT_CHANNELS[self.interface], **settings)
            return can.Bus(channel=self.channel, interface=self.interface, ignore_config=True, **settings)
        except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
            more = advice(_errno(error))
            if isinstance(error, can.CanInterfaceNotImplementedError):
                more = "; serial adapters and udp_multicast need pip install 'skinbus[serial,multicast]'"
            raise BusError(f"{self} cannot be opened: {error}{more}") from error


def known_interfaces() -> list[str]:
    """Names of all interfaces of python-can, plug-ins included."""
    return sorted(can.VALID_INTERFACES)


def _errno(error: BaseException) -> int | None:
    """The system's error number behind an error of python-can, if there is one."""
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    if isinstance(code, int):
        return code
    cause = error.__cause__
    return cause.errno if isinstance(cause, OSError) else None


def _is_full(error: Exception) -> bool:
    return isinstance(error, TimeoutError) or "buffer full" in str(error).lower()


def _raise_receive_buffer(bus: can.BusABC) -> None:
    """Ask for a larger receive buffer of a bus that has a socket."""
    with (
        contextlib.suppress(NotImplementedError, OSError),  # OSError: a serial port
        socket.socket(fileno=os.dup(bus.fileno())) as sock,
    ):
        raise_receive_buffer(sock, RECEIVE_BUFFER)


def _to_frame(message: can.Message, t_ns: int) -> Frame:
    """The frame in a message."""
    flags, data = EXTENDED if message.is_extended_id else 0, bytes(message.data or b"")[:MAX_DATA]
    if message.is_remote_frame:
        flags, data = flags | RTR, bytes(message.dlc)
    elif message.is_error_frame:
        flags = ERROR
    elif message.is_fd:
        flags |= FD | (BRS if message.bitrate_switch else 0) | (ESI if message.error_state_indicator else 0)
    return Frame(message.arbitration_id, data, t_ns, flags)


def _to_message(frame: Frame, tag: str | None) -> can.Message:
    can_id, data, _, flags, _ = frame
    remote = bool(flags & RTR)
    return can.Message(
        arbitration_id=can_id,
        is_extended_id=bool(flags & EXTENDED),
        is_remote_frame=remote,
        dlc=len(data),
        data=None if remote else data,
        is_fd=bool(flags & FD),
        bitrate_switch=bool(flags & BRS),
        error_state_indicator=bool(flags & ESI),
        channel=tag,
    )
