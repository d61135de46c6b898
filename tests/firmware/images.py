"""Images of programs, as the Makefile of a project makes them."""

import struct
import zlib


def make_image(program, vendor, product, version):
    """Return the image of a program."""
    body = struct.pack("<4I", vendor, product, version, 0) + program + b"\xff" * (-len(program) % 8)
    return struct.pack("<4s3I", b"SBP1", 0, len(body), zlib.crc32(body)) + body
