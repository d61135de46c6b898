"""The image of a program for a board: a head, and the bytes that its build made.

The head has, as U32 each: "SBP1", a number of the board's own, length and CRC-32 (that of zlib) of what
follows them, vendor-ID, product code, version, and 0. The program comes next, filled up to eight bytes.

This file is also in the project of a board, whose Makefile makes an image by it.
"""

from __future__ import annotations

import struct
import zlib

_SUMMED = 16
"""Bytes before those that length and checksum are of."""


def make_image(program: bytes, vendor: int, product: int, version: int) -> bytes:
    """Return the image of a program."""
    body = struct.pack("<4I", vendor, product, version, 0) + program + b"\xff" * (-len(program) % 8)
    return struct.pack("<4s3I", b"SBP1", 0, len(body), zlib.crc32(body)) + body


def read_image(image: bytes) -> tuple[int, ...]:
    """Return checksum, vendor-ID, product code and version; nothing if it is no image, or not whole."""
    _, length, crc, *board = struct.unpack_from("<6I", image[4:].ljust(24))
    body = image[_SUMMED : _SUMMED + length]
    return (crc, *board) if len(body) == length and zlib.crc32(body) == crc else ()
