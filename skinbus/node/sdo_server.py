"""The SDO server: one transfer at a time, expedited, in segments or in blocks, each a generator of answers.

A transfer yields what it answers and which request goes on with it, is sent that request, and returns its
last answers. Source: CiA 301, 7.2.4.3; block transfers 7.2.4.3.8 to 7.2.4.3.16.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from collections.abc import Callable, Generator, Sequence

from skinbus.can.core import NEVER
from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.node.context import Context, Handlers, Part
from skinbus.node.dictionary import MAX_LENGTH, SdoAbort
from skinbus.node.nmt import Service
from skinbus.objects.cia import SDO_CLIENT_BASE, SDO_SERVER, SDO_SERVER_BASE, AbortCode

DEFAULT_TIMEOUT_NS = 1_000_000_000
FRAME_LENGTH = 8
SEGMENT = 7
"""Bytes of a segment."""
MAX_BLOCK = 127
"""Segments of a block."""
BURST = 4
PACE_NS = 1_000_000
"""A block goes out in bursts so far apart: what is more urgent does not wait for all of it in the queue."""

HEAD = struct.Struct("<BHB")
HEAD_AND_NUMBER = struct.Struct("<BHBI")

# First byte: command in bits 5-7, the rest by command.
EXPEDITED = 0x02
SIZE_GIVEN = 0x01
TOGGLE = 0x10
LAST_SEGMENT = 0x01
ABORT = 0x80
"""The same both ways."""
BLOCK_CRC = 0x04
BLOCK_SIZE_GIVEN = 0x02
BLOCK_LAST = 0x80
"""Bit of the number of the last segment."""

# What a client asks for.
DOWNLOAD, UPLOAD, BLOCK_UPLOAD, BLOCK_DOWNLOAD, UNKNOWN = 1, 2, 5, 6, 7
LATER_STEP = {BLOCK_UPLOAD: 0x03, BLOCK_DOWNLOAD: 0x01}
"""Bits that are 0 where a block transfer begins."""

Request = tuple[int, int]
"""Requests by their first byte: bits that are looked at, and their values."""
DOWNLOAD_SEGMENT: Request = (0xE0, 0x00)
UPLOAD_SEGMENT: Request = (0xE0, 0x60)
BLOCK_SEGMENT: Request = (0x00, 0x00)
"""All that is no abort."""
BLOCK_DOWNLOAD_END: Request = (0xE1, 0xC1)
BLOCK_UPLOAD_END: Request = (0xE3, 0xA1)
BLOCK_UPLOAD_GOT: Request = (0xE3, 0xA2)
BLOCK_UPLOAD_BEGIN: Request = (0xE3, 0xA3)

Transfer = Generator[tuple[Sequence[bytes], Request], bytes, Sequence[bytes]]
"""It is sent a request, or nothing, b"", when the next burst is due."""


class SdoServer(Part):
    """Answers the default SDO channel of a device (0x1200)."""

    kind = Service.SDO

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._index = self._sub = 0
        self._starts: dict[int, Callable[[bytes], Transfer]] = {
            DOWNLOAD: self._download,
            UPLOAD: self._upload,
            BLOCK_UPLOAD: self._block_upload,
            BLOCK_DOWNLOAD: self._block_download,
        }
        self.reset()

    def reset(self) -> None:
        """Abandon the transfer; nothing is sent."""
        self._transfer: Transfer | None = None
        self._goes_on: Request = BLOCK_SEGMENT
        self.wake_ns = self._deadline_ns = self._burst_ns = NEVER

    def handlers(self) -> Handlers:
        """What this service listens to."""
        rx = self.values.number(SDO_SERVER, 1, SDO_CLIENT_BASE + self.context.node_id)
        self._tx = self.values.number(SDO_SERVER, 2, SDO_SERVER_BASE + self.context.node_id)
        return {rx: self.receive}

    def receive(self, frame: Frame) -> None:
        """One request."""
        data = frame.data
        if len(data) != FRAME_LENGTH:
            self.context.drop(frame, "an SDO has 8 bytes")
            return
        bits, wanted = self._goes_on
        if self._transfer and data[0] != ABORT and data[0] & bits == wanted:
            self._go_on(data)
        elif data[0] & 0xE0 == ABORT:
            self.reset()
        else:  # a new start is allowed in the middle of a transfer, which it ends
            self._start(data)

    def tick(self) -> None:
        """Send on in a block, or abort a transfer whose client has gone."""
        if self.context.now_ns >= self._burst_ns:
            self._go_on(b"")
        elif self.context.now_ns >= self._deadline_ns:
            self._abort(AbortCode.TIMEOUT)

    def _start(self, data: bytes) -> None:
        """Begin a transfer, or refuse what begins none; that names no object but by an unknown command."""
        command = data[0] >> 5
        start = None if data[0] & LATER_STEP.get(command, 0) else self._starts.get(command)
        if start or command == UNKNOWN:
            _, self._index, self._sub = HEAD.unpack_from(data)
        elif not self._transfer:
            self._index = self._sub = 0
        if not start:
            self._abort(AbortCode.COMMAND)
            return
        self.reset()
        self._transfer = start(data)
        self._go_on(None)

    def _go_on(self, request: bytes | None) -> None:
        """Let the transfer take a request and answer; its client gets its time anew."""
        assert self._transfer is not None
        self._burst_ns = NEVER
        try:
            answers, self._goes_on = self._transfer.send(request)  # type: ignore[arg-type]
            self._deadline_ns = self.context.now_ns + DEFAULT_TIMEOUT_NS
            self.wake_ns = min(self._deadline_ns, self._burst_ns)
        except StopIteration as end:
            answers = end.value
            self.reset()
        except SdoAbort as abort:
            self._abort(abort.code)
            return
        except OSError as error:  # of the storage
            self.context.report(EventKind.STORAGE, str(error))
            self._abort(AbortCode.HARDWARE)
            return
        for answer in answers:
            self.context.send(self._tx, answer)

    def _abort(self, code: int) -> None:
        self.reset()
        self.context.send(self._tx, self._head(ABORT, code))

    def _head(self, command: int, number: int) -> bytes:
        return HEAD_AND_NUMBER.pack(command, self._index, self._sub, number)

    def _download(self, data: bytes) -> Transfer:
        command, _, _, number = HEAD_AND_NUMBER.unpack(data)
        answer = self._head(0x60, 0)
        if command & EXPEDITED:
            entry = self.dictionary.admit(self._index, self._sub, None)
            length = 4 - (command >> 2 & 3) if command & SIZE_GIVEN else min(entry.size or 4, 4)
            self.dictionary.write(self._index, self._sub, data[4 : 4 + length])
            return [answer]
        announced = number if command & SIZE_GIVEN else None
        entry = self.dictionary.admit(self._index, self._sub, announced)
        most = (entry.size or MAX_LENGTH) if announced is None else announced
        came, toggle = bytearray(), 0
        while True:
            segment = yield [answer], DOWNLOAD_SEGMENT
            toggle = next_toggle(segment, toggle)
            came += segment[1 : 8 - (segment[0] >> 1 & 7)]
            if len(came) > most:
                raise SdoAbort(AbortCode.LENGTH_HIGH)
            answer = bytes((0x20 | segment[0] & TOGGLE,)) + bytes(7)
            if segment[0] & LAST_SEGMENT:
                if announced is not None and len(came) < announced:
                    raise SdoAbort(AbortCode.LENGTH_LOW)
                self.dictionary.write(self._index, self._sub, bytes(came))
                return [answer]

    def _upload(self, data: bytes) -> Transfer:
        value = self.dictionary.read(self._index, self._sub)
        n = len(value)
        if 0 < n <= 4:
            command = 0x40 | (4 - n) << 2 | EXPEDITED | SIZE_GIVEN
            return [HEAD.pack(command, self._index, self._sub) + value.ljust(4, b"\0")]
        answer, toggle, at = self._head(0x40 | SIZE_GIVEN, n), 0, 0
        while True:
            request = yield [answer], UPLOAD_SEGMENT
            toggle = next_toggle(request, toggle)
            chunk = value[at : at + SEGMENT]
            at += SEGMENT
            command = request[0] & TOGGLE | (SEGMENT - len(chunk)) << 1 | (LAST_SEGMENT if at >= n else 0)
            answer = bytes((command,)) + chunk.ljust(SEGMENT, b"\0")
            if at >= n:
                return [answer]

    def _block_download(self, data: bytes) -> Transfer:
        """Take blocks: after each the client is told up to which segment all came, and goes on from there."""
        command, _, _, number = HEAD_AND_NUMBER.unpack(data)
        announced = number if command & BLOCK_SIZE_GIVEN else None
        self.dictionary.admit(self._index, self._sub, announced)
        answers, came = [self._head(0xA0 | BLOCK_CRC, MAX_BLOCK)], bytearray()
        got, is_complete = 0, False
        while not is_complete:
            segment = yield answers, BLOCK_SEGMENT
            number, is_last, answers = segment[0] & ~BLOCK_LAST, segment[0] & BLOCK_LAST, []
            if number == 0:
                raise SdoAbort(AbortCode.SEQUENCE)
            if number == got + 1:
                got, is_complete = number, bool(is_last)
                came += segment[1:]
                if len(came) > MAX_LENGTH + SEGMENT:
                    raise SdoAbort(AbortCode.MEMORY)
            if is_last or number == MAX_BLOCK:
                answers, got = [bytes((0xA2, got, MAX_BLOCK)) + bytes(5)], 0
        end = yield answers, BLOCK_DOWNLOAD_END
        value = bytes(came[: len(came) - (end[0] >> 2 & 7)])
        if announced is not None and len(value) != announced:
            is_long = len(value) > announced
            raise SdoAbort(AbortCode.LENGTH_HIGH if is_long else AbortCode.LENGTH_LOW)
        if command & BLOCK_CRC and crc_hqx(value, 0) != int.from_bytes(end[1:3], "little"):
            raise SdoAbort(AbortCode.CRC)
        self.dictionary.write(self._index, self._sub, value)
        return [bytes((0xA1,)) + bytes(7)]

    def _block_upload(self, data: bytes) -> Transfer:
        """Send blocks, in bursts; the client says up to which segment it has got all."""
        value = self.dictionary.read(self._index, self._sub)
        n, size, threshold = len(value), data[4], data[5]
        if threshold and n <= threshold:  # not worth a block, the client says
            return (yield from self._upload(data))
        check_block(size)
        yield [self._head(0xC0 | BLOCK_CRC | BLOCK_SIZE_GIVEN, n)], BLOCK_UPLOAD_BEGIN
        begin = 0
        while begin < max(n, 1):
            most, sent, request = min(size, max(-(-(n - begin) // SEGMENT), 1)), 0, b""
            while not request:
                burst = range(sent, min(sent + BURST, most))
                segments = [_segment(value, begin, number) for number in burst]
                sent = burst.stop
                if sent < most:
                    self._burst_ns = self.context.now_ns + PACE_NS
                request = yield segments, BLOCK_UPLOAD_GOT
            got, size = request[1:3]
            if got > sent:
                raise SdoAbort(AbortCode.SEQUENCE)
            begin += SEGMENT * got
            check_block(size)
        unused = -n % SEGMENT if n else SEGMENT
        crc = crc_hqx(value, 0) if data[0] & BLOCK_CRC else 0
        end = struct.pack("<BH5x", 0xC1 | unused << 2, crc)
        yield [end], BLOCK_UPLOAD_END
        return []


def next_toggle(data: bytes, toggle: int) -> int:
    """Return the toggle bit that follows; SdoAbort where this one is not what it should be."""
    if data[0] & TOGGLE != toggle:
        raise SdoAbort(AbortCode.TOGGLE)
    return toggle ^ TOGGLE


def check_block(size: int) -> None:
    """Raise SdoAbort for a block of so many segments, if there can be none."""
    if not 1 <= size <= MAX_BLOCK:
        raise SdoAbort(AbortCode.BLOCK_SIZE)


def _segment(value: bytes, begin: int, number: int) -> bytes:
    """Return a segment of a block, numbered from 0, that begins at a byte of a value."""
    start = begin + SEGMENT * number
    is_last = start + SEGMENT >= len(value)
    chunk = value[start : start + SEGMENT].ljust(SEGMENT, b"\0")
    return bytes((number + 1 | (BLOCK_LAST if is_last else 0),)) + chunk
