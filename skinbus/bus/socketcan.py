"""A SocketCAN interface read in batches: one socket for the data plane, one for all else.

The kernel sorts: identifiers that carry readings go to the data socket and from there, many with one system
call, into a ``FrameBatch``; the control socket holds the rest. Frames that the kernel had no room for are
counted, error frames become events, and an interface that goes down or away is a BusError at once.
"""

from __future__ import annotations

import contextlib
import errno
import select
import socket
import time
from pathlib import Path

from skinbus.bus.interface import BAD_FRAME, RETRY_S, SEND_PATIENCE_S, Bus, advice
from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.bus.socketcan_babble import BabbleWatch, BacklogDrops
from skinbus.bus.socketcan_batch import (
    CAN_RAW_ERR_FILTER,
    CANFD_MTU,
    CHUNK,
    MAX_FRAMES,
    BatchReader,
    BatchWriter,
    filters,
    finish_kernel,
    raise_receive_buffer,
    to_frames,
)
from skinbus.can.error_frames import ERR_OF_INTEREST, FaultWatch
from skinbus.can.event import Event
from skinbus.can.frame import ERROR, CobIds, Frame, FrameBatch, Frames
from skinbus.errors import BusError

RECEIVE_BUFFER = 8 << 20
"""Bytes of socket buffer asked for: some 10 000 frames, more than a second of a full 1 Mbit/s bus."""

_FULL = {errno.ENOBUFS, errno.EAGAIN, errno.EINTR, errno.ENOMEM}


class SocketCanBus(Bus):
    """An open interface; raises BusError when it is gone."""

    gives_up_in_order = True

    def __init__(
        self,
        channel: str = "can0",
        *,
        fd: bool = False,
        receive_buffer: int = RECEIVE_BUFFER,
    ) -> None:
        """Open it; bit rates are set by ``ip link``, not here.

        fd  whether CAN FD frames may be sent and are received
        Raises BusError that says what to do about it.
        """
        self.channel = channel
        self.fd = fd
        self.clock = MonotonicClock()
        self.n_received = 0
        self._stuck = False
        self._receive_buffer = receive_buffer
        self._data_ids: CobIds = frozenset()
        self._control = self._open(None)
        self._reader = BatchReader(self._control, self.clock, MAX_FRAMES)
        self._writer = BatchWriter(self._control)
        self._data: socket.socket | None = None
        self._data_reader: BatchReader | None = None
        self.batch = FrameBatch(1)
        self._sockets = [self._control]
        self._faults = FaultWatch()
        statistics = Path(f"/sys/class/net/{channel}/statistics")
        self._backlog = BacklogDrops(statistics / "rx_dropped")
        self._packets = statistics / "rx_packets"
        self._babble: BabbleWatch | None = None

    @property
    def n_dropped(self) -> int:
        """Received frames that the kernel had no room for, in our sockets or on the way there."""
        self._backlog.look()
        return self._n_dropped()

    def descriptors(self, *, for_data: bool = True) -> list[int]:
        """Descriptors that become readable with frames, those of the data plane only if wanted."""
        return [sock.fileno() for sock in (self._sockets if for_data else self._sockets[:1])]

    def listen(self, cob_ids: CobIds | None, data_ids: CobIds = frozenset()) -> None:
        """Receive only these identifiers (None: all), of them ``data_ids`` into the batch.

        Raises BusError if the interface is down or gone.
        """
        try:
            if data_ids and self._data is None:
                self._data = self._open(data_ids)
                self._data_reader = BatchReader(self._data, self.clock, MAX_FRAMES, finish_kernel())
                self.batch = self._data_reader.batch
                self._sockets.append(self._data)
                self._babble = BabbleWatch(self._open(frozenset()), self._packets, self.clock)
            elif self._data is not None and data_ids != self._data_ids:
                _filter(self._data, data_ids)
            self._data_ids = data_ids
            _filter(self._control, None if cob_ids is None else cob_ids - data_ids)
        except BusError:
            raise
        except OSError as error:
            raise BusError(f"{self}: cannot listen: {error}") from error

    def receive(self, timeout_s: float = 0.0) -> list[Frame]:
        """All frames that are there, those of the data plane in ``batch``; waits ``timeout_s`` for the first.

        Raises BusError if the interface is down or gone.
        """
        if timeout_s > 0:
            select.select(self._sockets, (), (), timeout_s)
        try:
            n = self._reader.read()
            if self._data_reader:
                self.n_received += self._data_reader.read()
        except OSError as error:
            raise BusError(f"{self}: reception ended: {error}") from error
        if n == 0:
            return []
        frames = to_frames(self._reader.batch)
        if any(frame.flags & ERROR for frame in frames):
            self._faults.take([frame for frame in frames if frame.flags & ERROR])
            frames = [frame for frame in frames if not frame.flags & ERROR]
        self.n_received += len(frames)
        return frames

    def news(self) -> list[Event]:
        """Faults of the bus that were detected since the last call, and their ends.

        Who babbles is looked for when there is a data plane to protect.
        """
        now_ns = self.clock.now_ns()
        self._backlog.look(now_ns)
        n_dropped = self._n_dropped()
        try:
            babble = self._babble.news(now_ns) if self._babble else []
        except OSError:  # the interface is gone: ``receive`` reports that
            babble = []
        return self._faults.news(now_ns, n_dropped) + babble

    def send(self, frames: Frames) -> int:
        """Send frames in this order; returns how many were sent.

        Raises BusError if the interface is down or gone.
        """
        fit = [frame for frame in frames if self.fits(frame)]
        n_sent, first, give_up_s = 0, 0, 0.0
        while first < len(fit):
            try:
                n = self._writer.write(fit[first : first + CHUNK])
            except OSError as error:
                if error.errno in BAD_FRAME:
                    first += 1
                    continue
                if error.errno not in _FULL:
                    raise BusError(f"{self}: sending failed: {error}") from error
                now_s = time.monotonic()
                give_up_s = give_up_s or now_s + (0.0 if self._stuck else SEND_PATIENCE_S)
                if now_s >= give_up_s:
                    break
                time.sleep(RETRY_S)
            else:
                first, give_up_s = first + n, 0.0
                n_sent += n
        given_up = len(fit) - first
        self._stuck = given_up > 0 or (self._stuck and not n_sent)
        if given_up:
            self._faults.send_queue_full(given_up)
        if not self._stuck:
            self._faults.send_queue_free()
        return n_sent

    def close(self) -> None:
        """Let go of the interface; a second call does nothing."""
        parts = [*self._sockets, *([self._babble] if self._babble else ())]
        try:
            with contextlib.ExitStack() as stack:  # all of them, also when one fails at it
                for part in parts:
                    stack.callback(part.close)
        except OSError as error:
            raise BusError(f"{self}: closing failed: {error}") from error

    def _n_dropped(self) -> int:
        in_sockets = self._reader.n_dropped + (self._data_reader.n_dropped if self._data_reader else 0)
        return in_sockets + self._backlog.n

    def _open(self, cob_ids: CobIds | None) -> socket.socket:
        """A raw socket that receives these identifiers; one that receives all receives error frames too."""
        try:
            sock = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        except OSError as error:
            raise self._refused(error) from error
        try:
            _filter(sock, frozenset())  # nothing before all is set
            raise_receive_buffer(sock, self._receive_buffer)
            if cob_ids is None:
                sock.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, ERR_OF_INTEREST)
            if self.fd:
                sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
                mtu = int(Path(f"/sys/class/net/{self.channel}/mtu").read_text())
                if mtu < CANFD_MTU:
                    raise BusError(f"{self} cannot be opened: it is not a CAN FD interface (mtu {mtu})")
            sock.bind((self.channel,))
            code = sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if code:
                raise OSError(code, errno.errorcode.get(code, "error"))
            _filter(sock, cob_ids)
            sock.setblocking(False)
        except BusError:
            sock.close()
            raise
        except OSError as error:
            sock.close()
            raise self._refused(error) from error
        return sock

    def _refused(self, error: OSError) -> BusError:
        return BusError(f"{self} cannot be opened: {error}{_advice(self.channel, error.errno)}")

    def __str__(self) -> str:
        return f"socketcan {self.channel}"


def _filter(sock: socket.socket, cob_ids: CobIds | None) -> None:
    sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters(cob_ids))


def _advice(channel: str, code: int | None) -> str:
    folder = Path("/sys/class/net", channel)
    if code in (errno.ENODEV, errno.ENOENT):
        if channel and folder.exists():
            return f"; {channel} is not a CAN interface"
        return f"; is it there? see: ip link show {channel}"
    if code == errno.ENETDOWN:
        bitrate = "" if "virtual" in folder.resolve().parts else " type can bitrate 1000000"
        return f"; bring it up: ip link set {channel} up{bitrate}"
    return advice(code)
