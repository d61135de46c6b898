"""Handles of the rig: interfaces made, taken down and removed."""

import fcntl
import socket
import struct
import subprocess
from pathlib import Path

EDS = Path(__file__).parents[2] / "eds"


def ip(*words):
    """Run ip(8)."""
    subprocess.run(["ip", *words], check=True, capture_output=True)


def set_up(channel, up):
    """Bring an interface up or down at once: starting ip(8) takes up to a second on a busy machine."""
    request = struct.Struct("16sH14x")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        _, flags = request.unpack(fcntl.ioctl(sock, 0x8913, request.pack(channel.encode(), 0)))
        flags = flags | 1 if up else flags & ~1
        fcntl.ioctl(sock, 0x8914, request.pack(channel.encode(), flags))
