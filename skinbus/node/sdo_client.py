"""An SDO client without I/O: one expedited or segmented transfer at a time with one server.

``start_read`` or ``start_write``, then ``step`` with time and frames until ``busy`` is False; ``result`` then
holds the data or the abort code. Many clients stepped side by side make many transfers at once.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import NamedTuple

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame, Frames
from skinbus.errors import LocalProtocolError, SdoAborted
from skinbus.node.dictionary import MAX_LENGTH, SdoAbort
from skinbus.node.sdo_server import (
    ABORT,
    EXPEDITED,
    FRAME_LENGTH,
    HEAD,
    HEAD_AND_NUMBER,
    LAST_SEGMENT,
    SEGMENT,
    SIZE_GIVEN,
    next_toggle,
)
from skinbus.objects.cia import SDO_CLIENT_BASE, SDO_SERVER_BASE, AbortCode

DEFAULT_TIMEOUT_NS = 300_000_000

ASK_DOWNLOAD = 0x20
ASK_DOWNLOAD_SEGMENT = 0x00
ASK_UPLOAD = 0x40
ASK_UPLOAD_SEGMENT = 0x60

# What a server answers: its command specifier.
ANSWER_UPLOAD_SEGMENT = 0
ANSWER_DOWNLOAD_SEGMENT = 1
ANSWER_UPLOAD = 2
ANSWER_DOWNLOAD = 3

Transfer = Generator[tuple[bytes, int], bytes, bytes]
"""Yields a request and which answer goes on with it, is sent that answer, returns what was read."""


class SdoResult(NamedTuple):
    """End of a transfer: the data read (empty after a write), or an abort code."""

    node_id: int
    index: int  # type: ignore[assignment]  # hides tuple.index, which is not used here
    sub: int
    data: bytes = b""
    abort: int | None = None

    def unwrap(self) -> bytes:
        """The data; SdoAborted if the transfer was aborted."""
        if self.abort is not None:
            raise SdoAborted(self.node_id, self.index, self.sub, self.abort)
        return self.data


def expedited_write(index: int, sub: int, data: bytes) -> bytes:
    """Return the request that writes one to four bytes (CiA 301, 7.2.4.3.3)."""
    command = ASK_DOWNLOAD | (4 - len(data)) << 2 | EXPEDITED | SIZE_GIVEN
    return HEAD.pack(command, index, sub) + bytes(data).ljust(4, b"\0")


class SdoClient:
    """One transfer at a time with the server of ``node_id``."""

    def __init__(self, node_id: int, *, timeout_ns: int = DEFAULT_TIMEOUT_NS) -> None:
        self.node_id = node_id
        self.request_id = SDO_CLIENT_BASE + node_id
        self.answer_id = SDO_SERVER_BASE + node_id
        self.timeout_ns = timeout_ns
        self.result: SdoResult | None = None
        self._index = self._sub = 0
        self.cancel()

    @property
    def busy(self) -> bool:
        """Whether a transfer is going on."""
        return self._transfer is not None

    def start_read(self, index: int, sub: int) -> None:
        """Begin an upload; its request leaves with the next step."""
        self._start(index, sub, _read(HEAD.pack(ASK_UPLOAD, index, sub) + bytes(4)))

    def start_write(self, index: int, sub: int, data: bytes) -> None:
        """Begin a download; its request leaves with the next step."""
        n = len(data)
        if 0 < n <= 4:
            transfer = _write(expedited_write(index, sub, data), ())
        else:
            segments = [bytes(data[k : k + SEGMENT]) for k in range(0, max(n, 1), SEGMENT)]
            transfer = _write(HEAD_AND_NUMBER.pack(ASK_DOWNLOAD | SIZE_GIVEN, index, sub, n), segments)
        self._start(index, sub, transfer)

    def cancel(self) -> None:
        """Abandon the transfer and send nothing, as when the server has rebooted."""
        self._transfer: Transfer | None = None
        self._first = b""
        self.wake_ns = NEVER

    def step(self, now_ns: int, frames: Frames = ()) -> list[Frame]:
        """Take frames (others than this server's answers are ignored) and return those to send."""
        out: list[bytes] = []
        if self._first:
            out.append(self._first)
            self._first = b""
            self.wake_ns = now_ns + self.timeout_ns
        for frame in frames:
            if frame.can_id == self.answer_id and not frame.flags and len(frame.data) == FRAME_LENGTH:
                out += self._receive(frame.data)
                if self.busy:
                    self.wake_ns = now_ns + self.timeout_ns
        if self.busy and now_ns >= self.wake_ns:
            out.append(self._abort(AbortCode.TIMEOUT))
        return [Frame(self.request_id, data, now_ns) for data in out]

    def _start(self, index: int, sub: int, transfer: Transfer) -> None:
        if self.busy:
            raise LocalProtocolError(f"node {self.node_id}: an SDO transfer is going on")
        self._index, self._sub = index, sub
        self._transfer = transfer
        self._first, self._goes_on = next(transfer)
        self.result = None
        self.wake_ns = 0

    def _receive(self, data: bytes) -> Sequence[bytes]:
        """The next request; none when nothing is left to say or the answer is not for this transfer."""
        if not self._transfer or self._first:
            return ()
        command, index, sub, code = HEAD_AND_NUMBER.unpack(data)
        is_ours = (index, sub) == (self._index, self._sub)
        answer = command >> 5
        if answer == ABORT >> 5:
            if is_ours or (index, sub) == (0, 0):
                self._finish(abort=code)
            return ()
        if answer in (ANSWER_UPLOAD, ANSWER_DOWNLOAD) and not is_ours:
            return ()  # the late answer to a transfer given up
        if answer != self._goes_on:
            return (self._abort(AbortCode.COMMAND),)
        try:
            request, self._goes_on = self._transfer.send(data)
        except StopIteration as end:
            self._finish(data=end.value)
            return ()
        except SdoAbort as abort:
            return (self._abort(abort.code),)
        return (request,)

    def _abort(self, code: int) -> bytes:
        self._finish(abort=code)
        return HEAD_AND_NUMBER.pack(ABORT, self._index, self._sub, code)

    def _finish(self, data: bytes = b"", abort: int | None = None) -> None:
        self.cancel()
        self.result = SdoResult(self.node_id, self._index, self._sub, data, abort)


def _read(request: bytes) -> Transfer:
    answer = yield request, ANSWER_UPLOAD
    if answer[0] & EXPEDITED:
        return answer[4 : 8 - (answer[0] >> 2 & 3)] if answer[0] & SIZE_GIVEN else answer[4:]
    announced = int.from_bytes(answer[4:8], "little") if answer[0] & SIZE_GIVEN else None
    came, toggle, is_last = bytearray(), 0, 0
    while not is_last:
        answer = yield bytes((ASK_UPLOAD_SEGMENT | toggle,)) + bytes(7), ANSWER_UPLOAD_SEGMENT
        toggle = next_toggle(answer, toggle)
        came += answer[1 : 8 - (answer[0] >> 1 & 7)]
        n, is_last = len(came), answer[0] & LAST_SEGMENT
        if announced is not None and (n > announced or (is_last and n < announced)):
            raise SdoAbort(AbortCode.LENGTH)
        if n > MAX_LENGTH:
            raise SdoAbort(AbortCode.MEMORY)
    return bytes(came)


def _write(request: bytes, segments: Sequence[bytes]) -> Transfer:
    yield request, ANSWER_DOWNLOAD
    toggle = 0
    for k, segment in enumerate(segments, 1):
        last = LAST_SEGMENT if k == len(segments) else 0
        command = ASK_DOWNLOAD_SEGMENT | toggle | (SEGMENT - len(segment)) << 1 | last
        answer = yield bytes((command,)) + segment.ljust(SEGMENT, b"\0"), ANSWER_DOWNLOAD_SEGMENT
        toggle = next_toggle(answer, toggle)
    return b""
