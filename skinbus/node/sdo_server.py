"""The SDO server: expedited, segmented and block transfers, one at a time, by tables of phase and command."""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import Enum, auto

from skinbus.can.core import NEVER
from skinbus.can.frame import Frame
from skinbus.node.context import Context, Handler
from skinbus.node.dictionary import MAX_LENGTH, Dictionary, SdoAbort
from skinbus.node.nmt import Service
from skinbus.node.sdo_block import (
    ACKNOWLEDGE,
    BEGIN,
    CRC_SUPPORTED,
    END,
    END_OF_DOWNLOAD,
    INITIATE,
    MAX_BLOCK,
    REPLY_DOWNLOAD_END,
    SEGMENT,
    UPLOAD_STEP,
    BlockDownload,
    BlockUpload,
)
from skinbus.node.sdo_block import REPLY_DOWNLOAD as REPLY_BLOCK_DOWNLOAD
from skinbus.node.sdo_block import REPLY_UPLOAD as REPLY_BLOCK_UPLOAD
from skinbus.node.sdo_block import SIZE_GIVEN as BLOCK_SIZE_GIVEN
from skinbus.objects.cia import SDO_CLIENT_BASE, SDO_SERVER, SDO_SERVER_BASE, AbortCode

DEFAULT_TIMEOUT_NS = 1_000_000_000
FRAME_LENGTH = 8

# First byte, CiA 301 7.2.4.3: command in bits 5-7, the rest by command.
EXPEDITED = 0x02
SIZE_GIVEN = 0x01
TOGGLE = 0x10
LAST_SEGMENT = 0x01
REPLY_DOWNLOAD = 0x60
REPLY_DOWNLOAD_SEGMENT = 0x20
REPLY_UPLOAD = 0x40
REPLY_UPLOAD_SEGMENT = 0x00
ABORT = 0x80
"""The same both ways."""

HEAD = struct.Struct("<BHB")
HEAD_AND_NUMBER = struct.Struct("<BHBI")


class Command(Enum):
    """What a client may ask; the value is the command specifier."""

    DOWNLOAD_SEGMENT = 0
    DOWNLOAD = 1
    UPLOAD = 2
    UPLOAD_SEGMENT = 3
    ABORT = 4
    BLOCK_UPLOAD = 5
    BLOCK_DOWNLOAD = 6
    UNKNOWN = 7


class Phase(Enum):
    """Where the transfer stands."""

    IDLE = auto()
    DOWNLOADING = auto()
    UPLOADING = auto()
    BLOCK_DOWNLOADING = auto()
    BLOCK_DOWNLOADED = auto()
    BLOCK_UPLOAD_ASKED = auto()
    BLOCK_UPLOADING = auto()
    BLOCK_UPLOADED = auto()


BURST = 4
PACE_NS = 1_000_000
"""A block goes out in bursts so far apart: what is more urgent does not wait for all of it in the queue."""

_COMMANDS = tuple(Command(i) for i in range(8))


class SdoServer:
    """Answers the default SDO channel of a device (0x1200)."""

    kind = Service.SDO

    def __init__(
        self, context: Context, dictionary: Dictionary, timeout_ns: int = DEFAULT_TIMEOUT_NS
    ) -> None:
        self.context = context
        self.dictionary = dictionary
        self.timeout_ns = timeout_ns
        self.wake_ns = NEVER
        self.phase = Phase.IDLE
        self._index = self._sub = 0
        self._toggle = 0
        self._buffer = bytearray()
        self._announced: int | None = None
        self._position = 0
        self._deadline_ns = self._burst_ns = NEVER
        self._block_down = BlockDownload(None, with_crc=False)
        self._block_up = BlockUpload(b"", MAX_BLOCK, with_crc=False)
        start: dict[Command, Callable[[bytes], None]] = {
            Command.DOWNLOAD: self._download,
            Command.UPLOAD: self._upload,
            Command.ABORT: self._aborted,
            Command.BLOCK_DOWNLOAD: self._block_download,
            Command.BLOCK_UPLOAD: self._block_upload,
        }
        # A new start is allowed in the middle of a transfer, which it ends; what is missing here is refused.
        self._table: dict[Phase, dict[Command, Callable[[bytes], None]]] = {
            Phase.IDLE: start,
            Phase.DOWNLOADING: {**start, Command.DOWNLOAD_SEGMENT: self._download_segment},
            Phase.UPLOADING: {**start, Command.UPLOAD_SEGMENT: self._upload_segment},
            Phase.BLOCK_DOWNLOADING: {Command.ABORT: self._aborted},  # all else is a segment
            Phase.BLOCK_DOWNLOADED: start,
            Phase.BLOCK_UPLOAD_ASKED: start,
            Phase.BLOCK_UPLOADING: start,
            Phase.BLOCK_UPLOADED: start,
        }
        self._upload_steps: dict[tuple[Phase, int], Callable[[bytes], None]] = {
            **{(phase, INITIATE): self._block_upload_asked for phase in Phase},
            (Phase.BLOCK_UPLOAD_ASKED, BEGIN): self._block_begin,
            (Phase.BLOCK_UPLOADING, ACKNOWLEDGE): self._block_acknowledged,
            (Phase.BLOCK_UPLOADED, END): self._aborted,
        }

    def reset(self) -> None:
        """Abandon the transfer; nothing is sent."""
        self.phase = Phase.IDLE
        self._buffer = bytearray()
        self.wake_ns = self._deadline_ns = self._burst_ns = NEVER

    def handlers(self) -> dict[int, Handler]:
        """What this service listens to."""
        rx = self.context.values.number(SDO_SERVER, 1, SDO_CLIENT_BASE + self.context.node_id)
        self._tx = self.context.values.number(SDO_SERVER, 2, SDO_SERVER_BASE + self.context.node_id)
        return {rx: self.receive}

    def receive(self, frame: Frame) -> None:
        """One request."""
        data = frame.data
        if len(data) != FRAME_LENGTH:
            self.context.drop(frame, "an SDO has 8 bytes")
            return
        command = _COMMANDS[data[0] >> 5]
        action = self._table[self.phase].get(command)
        if self.phase is Phase.BLOCK_DOWNLOADING and data[0] != ABORT:
            action = self._block_segment
        try:
            if action is None:
                if command not in (Command.DOWNLOAD_SEGMENT, Command.UPLOAD_SEGMENT):
                    _, self._index, self._sub = HEAD.unpack_from(data)
                elif self.phase is Phase.IDLE:
                    self._index = self._sub = 0
                raise SdoAbort(AbortCode.COMMAND)
            action(data)
        except SdoAbort as abort:
            self._abort(abort.code)
        self._wait()

    def tick(self) -> None:
        """Send on in a block, or abort a transfer whose client has gone."""
        if self.context.now_ns >= self._burst_ns:
            self._send_burst()
            self._wait()
        elif self.context.now_ns >= self._deadline_ns:
            self._abort(AbortCode.TIMEOUT)

    def _wait(self) -> None:
        """Give the client its time anew."""
        if self.phase is not Phase.IDLE:
            self._deadline_ns = self.context.now_ns + self.timeout_ns
            self.wake_ns = min(self._deadline_ns, self._burst_ns)

    def _abort(self, code: int) -> None:
        self.reset()
        self.context.send(self._tx, HEAD_AND_NUMBER.pack(ABORT, self._index, self._sub, code))

    def _aborted(self, data: bytes) -> None:
        self.reset()

    def _download(self, data: bytes) -> None:
        self.reset()
        command, self._index, self._sub, number = HEAD_AND_NUMBER.unpack(data)
        if command & EXPEDITED:
            entry = self.dictionary.admit(self._index, self._sub, None)
            length = 4 - (command >> 2 & 3) if command & SIZE_GIVEN else min(entry.size or 4, 4)
            self.dictionary.write(self._index, self._sub, data[4 : 4 + length])
        else:
            self._announced = number if command & SIZE_GIVEN else None
            self.dictionary.admit(self._index, self._sub, self._announced)
            self.phase = Phase.DOWNLOADING
            self._toggle = 0
        self.context.send(self._tx, HEAD_AND_NUMBER.pack(REPLY_DOWNLOAD, self._index, self._sub, 0))

    def _download_segment(self, data: bytes) -> None:
        command = data[0]
        self._check_toggle(command)
        self._buffer += data[1 : 8 - (command >> 1 & 7)]
        limit = MAX_LENGTH if self._announced is None else self._announced
        if len(self._buffer) > limit:
            raise SdoAbort(AbortCode.MEMORY if self._announced is None else AbortCode.LENGTH_HIGH)
        if command & LAST_SEGMENT:
            if self._announced is not None and len(self._buffer) < self._announced:
                raise SdoAbort(AbortCode.LENGTH_LOW)
            self.dictionary.write(self._index, self._sub, bytes(self._buffer))
            self.reset()
        self.context.send(self._tx, bytes((REPLY_DOWNLOAD_SEGMENT | command & TOGGLE,)) + bytes(7))

    def _upload(self, data: bytes) -> None:
        self.reset()
        _, self._index, self._sub = HEAD.unpack_from(data)
        value = self.dictionary.read(self._index, self._sub)
        n = len(value)
        if 0 < n <= 4:
            command = REPLY_UPLOAD | (4 - n) << 2 | EXPEDITED | SIZE_GIVEN
            self.context.send(self._tx, HEAD.pack(command, self._index, self._sub) + value + bytes(4 - n))
            return
        self._buffer = bytearray(value)
        self._position = 0
        self._toggle = 0
        self.phase = Phase.UPLOADING
        self.context.send(
            self._tx, HEAD_AND_NUMBER.pack(REPLY_UPLOAD | SIZE_GIVEN, self._index, self._sub, n)
        )

    def _upload_segment(self, data: bytes) -> None:
        self._check_toggle(data[0])
        chunk = bytes(self._buffer[self._position : self._position + SEGMENT])
        self._position += len(chunk)
        unused = SEGMENT - len(chunk)
        command = REPLY_UPLOAD_SEGMENT | data[0] & TOGGLE | unused << 1
        if self._position >= len(self._buffer):
            command |= LAST_SEGMENT
            self.reset()
        self.context.send(self._tx, bytes((command,)) + chunk + bytes(unused))

    def _check_toggle(self, command: int) -> None:
        if command & TOGGLE != self._toggle:
            raise SdoAbort(AbortCode.TOGGLE)
        self._toggle ^= TOGGLE

    def _block_download(self, data: bytes) -> None:
        if data[0] & END_OF_DOWNLOAD:
            if self.phase is not Phase.BLOCK_DOWNLOADED:
                self._out_of_turn()
            self.dictionary.write(self._index, self._sub, self._block_down.end(data))
            self.reset()
            self.context.send(self._tx, bytes((REPLY_DOWNLOAD_END,)) + bytes(7))
            return
        self.reset()
        command, self._index, self._sub, number = HEAD_AND_NUMBER.unpack(data)
        announced = number if command & BLOCK_SIZE_GIVEN else None
        self.dictionary.admit(self._index, self._sub, announced)
        self._block_down = BlockDownload(announced, with_crc=bool(command & CRC_SUPPORTED))
        self.phase = Phase.BLOCK_DOWNLOADING
        head = HEAD.pack(REPLY_BLOCK_DOWNLOAD | CRC_SUPPORTED, self._index, self._sub)
        self.context.send(self._tx, head + bytes((MAX_BLOCK, 0, 0, 0)))

    def _block_segment(self, data: bytes) -> None:
        answer = self._block_down.take(data)
        if self._block_down.is_complete:
            self.phase = Phase.BLOCK_DOWNLOADED
        if answer is not None:
            self.context.send(self._tx, answer)

    def _block_upload(self, data: bytes) -> None:
        step = self._upload_steps.get((self.phase, data[0] & UPLOAD_STEP))
        if step is None:
            self._out_of_turn()
        else:
            step(data)

    def _block_upload_asked(self, data: bytes) -> None:
        self.reset()
        _, self._index, self._sub = HEAD.unpack_from(data)
        size, threshold = data[4], data[5]
        value = self.dictionary.read(self._index, self._sub)
        if threshold and len(value) <= threshold:  # not worth a block, the client says
            self._upload(data)
            return
        self._block_up = BlockUpload(value, size, with_crc=bool(data[0] & CRC_SUPPORTED))
        self.phase = Phase.BLOCK_UPLOAD_ASKED
        command = REPLY_BLOCK_UPLOAD | CRC_SUPPORTED | BLOCK_SIZE_GIVEN
        self.context.send(self._tx, HEAD_AND_NUMBER.pack(command, self._index, self._sub, len(value)))

    def _block_begin(self, data: bytes) -> None:
        self.phase = Phase.BLOCK_UPLOADING
        self._block_up.begin()
        self._send_burst()

    def _block_acknowledged(self, data: bytes) -> None:
        self._block_up.acknowledge(data)
        if self._block_up.is_over:
            self.phase = Phase.BLOCK_UPLOADED
            self._burst_ns = NEVER
            self.context.send(self._tx, self._block_up.end())
        else:
            self._send_burst()

    def _send_burst(self) -> None:
        for segment in self._block_up.segments(BURST):
            self.context.send(self._tx, segment)
        self._burst_ns = self.context.now_ns + PACE_NS if self._block_up.is_sending else NEVER

    def _out_of_turn(self) -> None:
        """Refuse a step of a transfer that does not go on; such a request names no object."""
        if self.phase is Phase.IDLE:
            self._index = self._sub = 0
        raise SdoAbort(AbortCode.COMMAND)
