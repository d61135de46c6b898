"""An SDO client without I/O: one expedited or segmented transfer at a time with one server.

``start_read`` or ``start_write``, then ``step`` with time and frames until ``busy`` is False; ``result`` then
holds the data or the abort code. Many clients stepped side by side make many transfers at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, auto

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.errors import LocalProtocolError, SdoAborted
from skinbus.node.dictionary import MAX_LENGTH
from skinbus.node.sdo_block import SEGMENT
from skinbus.node.sdo_server import (
    ABORT,
    EXPEDITED,
    FRAME_LENGTH,
    HEAD,
    HEAD_AND_NUMBER,
    LAST_SEGMENT,
    SIZE_GIVEN,
    TOGGLE,
)
from skinbus.objects.cia import SDO_CLIENT_BASE, SDO_SERVER_BASE, AbortCode

DEFAULT_TIMEOUT_NS = 300_000_000

ASK_DOWNLOAD = 0x20
ASK_DOWNLOAD_SEGMENT = 0x00
ASK_UPLOAD = 0x40
ASK_UPLOAD_SEGMENT = 0x60

# What a server answers; the value is its command specifier.
ANSWER_UPLOAD_SEGMENT = 0
ANSWER_DOWNLOAD_SEGMENT = 1
ANSWER_UPLOAD = 2
ANSWER_DOWNLOAD = 3
ANSWER_ABORT = 4


class _Phase(Enum):
    IDLE = auto()
    READ_ASKED = auto()
    READING = auto()
    WRITE_ASKED = auto()
    WRITING = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class SdoResult:
    """End of a transfer: the data read (empty after a write), or an abort code; ``remote`` says whose."""

    node_id: int
    index: int
    sub: int
    data: bytes = b""
    abort: int | None = None
    remote: bool = False

    def unwrap(self) -> bytes:
        """The data; SdoAborted if the transfer was aborted."""
        if self.abort is not None:
            raise SdoAborted(self.node_id, self.index, self.sub, self.abort)
        return self.data


class SdoClient:
    """One transfer at a time with the server of ``node_id``."""

    def __init__(self, node_id: int, *, timeout_ns: int = DEFAULT_TIMEOUT_NS) -> None:
        self.node_id = node_id
        self.request_id = SDO_CLIENT_BASE + node_id
        self.answer_id = SDO_SERVER_BASE + node_id
        self.timeout_ns = timeout_ns
        self.result: SdoResult | None = None
        self.wake_ns = NEVER
        self._phase = _Phase.IDLE
        self._first = b""
        self._index = self._sub = 0
        self._data = b""
        self._expedited = False
        self._position = 0
        self._received = bytearray()
        self._announced: int | None = None
        self._toggle = 0
        self._table: dict[tuple[_Phase, int], Callable[[bytes], bytes | None]] = {
            (_Phase.READ_ASKED, ANSWER_UPLOAD): self._on_upload,
            (_Phase.READING, ANSWER_UPLOAD_SEGMENT): self._on_upload_segment,
            (_Phase.WRITE_ASKED, ANSWER_DOWNLOAD): self._on_download,
            (_Phase.WRITING, ANSWER_DOWNLOAD_SEGMENT): self._on_download_segment,
        }

    @property
    def busy(self) -> bool:
        """Whether a transfer is going on."""
        return self._phase is not _Phase.IDLE

    def start_read(self, index: int, sub: int) -> None:
        """Begin an upload; its request leaves with the next step."""
        self._start(_Phase.READ_ASKED, index, sub)
        self._first = HEAD.pack(ASK_UPLOAD, index, sub) + bytes(4)

    def start_write(self, index: int, sub: int, data: bytes) -> None:
        """Begin a download; its request leaves with the next step."""
        self._start(_Phase.WRITE_ASKED, index, sub)
        n = len(data)
        self._expedited = 0 < n <= 4
        if self._expedited:
            command = ASK_DOWNLOAD | (4 - n) << 2 | EXPEDITED | SIZE_GIVEN
            self._first = HEAD.pack(command, index, sub) + bytes(data) + bytes(4 - n)
        else:
            self._data = bytes(data)
            self._first = HEAD_AND_NUMBER.pack(ASK_DOWNLOAD | SIZE_GIVEN, index, sub, n)

    def cancel(self) -> None:
        """Abandon the transfer and send nothing, as when the server has rebooted."""
        self._phase = _Phase.IDLE
        self._first = b""
        self.wake_ns = NEVER

    def step(self, now_ns: int, frames: Sequence[Frame] = ()) -> list[Frame]:
        """Take frames (others than this server's answers are ignored) and return those to send."""
        out: list[bytes] = []
        if self._first:
            out.append(self._first)
            self._first = b""
            self.wake_ns = now_ns + self.timeout_ns
        for frame in frames:
            if frame.can_id == self.answer_id and not frame.flags and len(frame.data) == FRAME_LENGTH:
                reply = self._receive(frame.data)
                if reply is not None:
                    out.append(reply)
                if self.busy:
                    self.wake_ns = now_ns + self.timeout_ns
        if self.busy and now_ns >= self.wake_ns:
            out.append(self._abort(AbortCode.TIMEOUT))
        return [Frame(self.request_id, data, now_ns) for data in out]

    def _start(self, phase: _Phase, index: int, sub: int) -> None:
        if self.busy:
            raise LocalProtocolError(f"node {self.node_id}: an SDO transfer is going on")
        self._phase = phase
        self._index, self._sub = index, sub
        self._data = b""
        self._expedited = False
        self._position = 0
        self._received = bytearray()
        self._toggle = 0
        self.result = None
        self.wake_ns = 0

    def _receive(self, data: bytes) -> bytes | None:
        """The next request, or None when nothing is left to say or the answer is not for this transfer."""
        if not self.busy or self._first:
            return None
        answer = data[0] >> 5
        if answer == ANSWER_ABORT:
            _, index, sub, code = HEAD_AND_NUMBER.unpack(data)
            if (index, sub) in ((self._index, self._sub), (0, 0)):
                self._finish(abort=code, remote=True)
            return None
        if answer in (ANSWER_UPLOAD, ANSWER_DOWNLOAD) and HEAD.unpack_from(data)[1:] != (
            self._index,
            self._sub,
        ):
            return None  # the late answer to a transfer given up
        action = self._table.get((self._phase, answer))
        return self._abort(AbortCode.COMMAND) if action is None else action(data)

    def _on_upload(self, data: bytes) -> bytes | None:
        command = data[0]
        if command & EXPEDITED:
            n = 4 - (command >> 2 & 3) if command & SIZE_GIVEN else 4
            self._finish(data=data[4 : 4 + n])
            return None
        self._announced = int.from_bytes(data[4:8], "little") if command & SIZE_GIVEN else None
        self._phase = _Phase.READING
        return bytes((ASK_UPLOAD_SEGMENT,)) + bytes(7)

    def _on_upload_segment(self, data: bytes) -> bytes | None:
        command = data[0]
        if command & TOGGLE != self._toggle:
            return self._abort(AbortCode.TOGGLE)
        self._toggle ^= TOGGLE
        self._received += data[1 : 8 - (command >> 1 & 7)]
        n = len(self._received)
        if self._announced is not None and (
            n > self._announced or (command & LAST_SEGMENT and n < self._announced)
        ):
            return self._abort(AbortCode.LENGTH)
        if n > MAX_LENGTH:
            return self._abort(AbortCode.MEMORY)
        if command & LAST_SEGMENT:
            self._finish(data=bytes(self._received))
            return None
        return bytes((ASK_UPLOAD_SEGMENT | self._toggle,)) + bytes(7)

    def _on_download(self, data: bytes) -> bytes | None:
        if self._expedited:
            self._finish()
            return None
        self._phase = _Phase.WRITING
        return self._segment()

    def _on_download_segment(self, data: bytes) -> bytes | None:
        if data[0] & TOGGLE != self._toggle:
            return self._abort(AbortCode.TOGGLE)
        self._toggle ^= TOGGLE
        if self._position >= len(self._data):
            self._finish()
            return None
        return self._segment()

    def _segment(self) -> bytes:
        chunk = self._data[self._position : self._position + SEGMENT]
        self._position += len(chunk)
        unused = SEGMENT - len(chunk)
        last = LAST_SEGMENT if self._position >= len(self._data) else 0
        return bytes((ASK_DOWNLOAD_SEGMENT | self._toggle | unused << 1 | last,)) + chunk + bytes(unused)

    def _abort(self, code: int) -> bytes:
        self._finish(abort=code)
        return HEAD_AND_NUMBER.pack(ABORT, self._index, self._sub, code)

    def _finish(self, data: bytes = b"", abort: int | None = None, remote: bool = False) -> None:
        self._phase = _Phase.IDLE
        self.wake_ns = NEVER
        self.result = SdoResult(
            node_id=self.node_id, index=self._index, sub=self._sub, data=data, abort=abort, remote=remote
        )
