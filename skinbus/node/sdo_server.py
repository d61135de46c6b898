"""The SDO server: expedited and segmented transfers, one at a time, as a table of phases and commands.

Block transfer is declined with "command specifier not valid or unknown"; clients fall back to segments.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import Enum, auto
from typing import Final

from skinbus.bus.core import NEVER
from skinbus.bus.frame import Frame
from skinbus.node.context import Context, Handler
from skinbus.node.dictionary import MAX_LENGTH, Dictionary, SdoAbort
from skinbus.node.nmt import Service
from skinbus.objects.cia import SDO_CLIENT_BASE, SDO_SERVER, SDO_SERVER_BASE, AbortCode

DEFAULT_TIMEOUT_NS: Final = 1_000_000_000
FRAME_LENGTH: Final = 8
SEGMENT: Final = 7

# First byte, CiA 301 7.2.4.3: command in bits 5-7, the rest by command.
EXPEDITED: Final = 0x02
SIZE_GIVEN: Final = 0x01
TOGGLE: Final = 0x10
LAST_SEGMENT: Final = 0x01
REPLY_DOWNLOAD: Final = 0x60
REPLY_DOWNLOAD_SEGMENT: Final = 0x20
REPLY_UPLOAD: Final = 0x40
REPLY_UPLOAD_SEGMENT: Final = 0x00
REPLY_ABORT: Final = 0x80

HEAD: Final = struct.Struct("<BHB")
HEAD_AND_NUMBER: Final = struct.Struct("<BHBI")


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


_COMMANDS: Final = tuple(Command(i) for i in range(8))


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
        start: dict[Command, Callable[[bytes], None]] = {
            Command.DOWNLOAD: self._download,
            Command.UPLOAD: self._upload,
            Command.ABORT: self._aborted,
        }
        # A new start is allowed in the middle of a transfer, which it ends; what is missing here is refused.
        self._table: dict[Phase, dict[Command, Callable[[bytes], None]]] = {
            Phase.IDLE: start,
            Phase.DOWNLOADING: {**start, Command.DOWNLOAD_SEGMENT: self._download_segment},
            Phase.UPLOADING: {**start, Command.UPLOAD_SEGMENT: self._upload_segment},
        }

    def reset(self) -> None:
        """Forget the transfer; nothing is sent."""
        self.phase = Phase.IDLE
        self._buffer = bytearray()
        self.wake_ns = NEVER

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
        if self.phase is not Phase.IDLE:
            self.wake_ns = self.context.now_ns + self.timeout_ns

    def tick(self) -> None:
        """Abort a transfer whose client has gone."""
        if self.phase is not Phase.IDLE and self.context.now_ns >= self.wake_ns:
            self._abort(AbortCode.TIMEOUT)

    def _abort(self, code: int) -> None:
        self.reset()
        self.context.send(self._tx, HEAD_AND_NUMBER.pack(REPLY_ABORT, self._index, self._sub, code))

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
