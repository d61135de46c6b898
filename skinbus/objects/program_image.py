"""The image of a program for a board: a head, and the bytes that its build made.

The head has, as U32 each: "SBP1", a number of the board's own, length and CRC-32 (that of zlib) of what
follows them, vendor-ID, product code, version, and 0. The program comes next, filled up to eight bytes.

The Makefile in the project of a board makes it.
"""

from __future__ import annotations

import struct
import zlib

MAX_BYTES = 16_000_000
"""More than the flash of a microcontroller has."""


def read_image(image: bytes) -> tuple[int, ...]:
    """Return checksum, vendor-ID, product code and version; nothing if it is no image, or not whole."""
    _, length, crc, *board = struct.unpack_from("<6I", image[4:].ljust(24))
    body = image[16:][:length]
    return (crc, *board) if len(body) == length and zlib.crc32(body) == crc else ()
