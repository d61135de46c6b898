"""The two block transfers of an SDO server (CiA 301, 7.2.4.3.8 to 7.2.4.3.16), each as a small machine.

Segments carry seven bytes and a number from 1 to the size of a block; after each block the receiver says up
to which one it has got all, and the sender goes on from there. The last one is followed by a checksum.
"""

from __future__ import annotations

from binascii import crc_hqx

from skinbus.node.dictionary import MAX_LENGTH, SdoAbort
from skinbus.objects.cia import AbortCode

SEGMENT = 7
LAST = 0x80
"""Bit of the number of the last segment."""
MAX_BLOCK = 127
CRC_SUPPORTED = 0x04
SIZE_GIVEN = 0x02

# Client to server; the command specifier is in the upper three bits.
END_OF_DOWNLOAD = 0x01
UPLOAD_STEP = 0x03
"""Bits that say which step of an upload a request is."""
INITIATE = 0
END = 1
ACKNOWLEDGE = 2
BEGIN = 3

REPLY_DOWNLOAD = 0xA0
REPLY_DOWNLOAD_BLOCK = 0xA2
REPLY_DOWNLOAD_END = 0xA1
REPLY_UPLOAD = 0xC0
REPLY_UPLOAD_END = 0xC1


def checksum(data: bytes) -> int:
    """The CRC of CiA 301, 7.2.4.3.16: polynomial 0x1021, from 0."""
    return crc_hqx(data, 0)


class BlockDownload:
    """What a client sends in blocks."""

    def __init__(self, announced: int | None, *, with_crc: bool) -> None:
        self.is_complete = False
        """Whether the last segment is here; the end of the transfer follows."""
        self._announced = announced
        self._with_crc = with_crc
        self._data = bytearray()
        self._number = 0

    def take(self, segment: bytes) -> bytes | None:
        """Take a segment; return the answer if it is the last of its block."""
        number, is_last = segment[0] & ~LAST, bool(segment[0] & LAST)
        if number == 0:
            raise SdoAbort(AbortCode.SEQUENCE)
        if number == self._number + 1:
            self._number = number
            self._data += segment[1:]
            self.is_complete = is_last
            if len(self._data) > MAX_LENGTH + SEGMENT:
                raise SdoAbort(AbortCode.MEMORY)
        if not (is_last or number == MAX_BLOCK):
            return None
        # One that is missing, and all after it, are sent again in the next block.
        got, self._number = self._number, 0
        return bytes((REPLY_DOWNLOAD_BLOCK, got, MAX_BLOCK, 0, 0, 0, 0, 0))

    def end(self, request: bytes) -> bytes:
        """Return all that was sent; SdoAbort when it is not what was announced."""
        data = bytes(self._data[: len(self._data) - (request[0] >> 2 & 7)])
        if self._announced is not None and len(data) != self._announced:
            too_long = len(data) > self._announced
            raise SdoAbort(AbortCode.LENGTH_HIGH if too_long else AbortCode.LENGTH_LOW)
        if self._with_crc and checksum(data) != int.from_bytes(request[1:3], "little"):
            raise SdoAbort(AbortCode.CRC)
        return data


class BlockUpload:
    """What a client is sent in blocks."""

    def __init__(self, data: bytes, size: int, *, with_crc: bool) -> None:
        self.is_over = False
        """Whether the client has got all; the end of the transfer follows."""
        self._data = data
        self._with_crc = with_crc
        self._begin = 0
        self._next = 1
        self._resize(size)

    @property
    def is_sending(self) -> bool:
        """Whether segments of the present block are left."""
        return self._next <= self._last

    def begin(self) -> None:
        """Send the first block."""
        self._last = self._n_segments()

    def segments(self, n: int) -> list[bytes]:
        """Return the next ones of the present block, n at most."""
        out: list[bytes] = []
        while len(out) < n and self.is_sending:
            start = self._begin + SEGMENT * (self._next - 1)
            is_last = start + SEGMENT >= len(self._data)
            chunk = self._data[start : start + SEGMENT]
            out.append(bytes((self._next | (LAST if is_last else 0),)) + chunk.ljust(SEGMENT, b"\0"))
            self._next += 1
        return out

    def acknowledge(self, request: bytes) -> None:
        """Go on after the last segment that the client has got."""
        got, size = request[1], request[2]
        if got >= self._next:
            raise SdoAbort(AbortCode.SEQUENCE)
        self._begin += SEGMENT * got
        self.is_over = self._begin >= max(len(self._data), 1)
        self._resize(size)
        if not self.is_over:
            self._next, self._last = 1, self._n_segments()

    def end(self) -> bytes:
        """Return the frame that says how long the last segment was, with the checksum."""
        unused = -len(self._data) % SEGMENT if self._data else SEGMENT
        crc = checksum(self._data) if self._with_crc else 0
        return bytes((REPLY_UPLOAD_END | unused << 2,)) + crc.to_bytes(2, "little") + bytes(5)

    def _resize(self, size: int) -> None:
        if not 1 <= size <= MAX_BLOCK:
            raise SdoAbort(AbortCode.BLOCK_SIZE)
        self._size = size
        self._last = 0

    def _n_segments(self) -> int:
        left = max(-(-(len(self._data) - self._begin) // SEGMENT), 1)
        return min(self._size, left)
