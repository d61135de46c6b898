"""One frame of every kind that is not CAN FD."""

from skinbus.can.frame import EXTENDED, RTR, Frame

EVERY_KIND = [
    Frame(0x181, b"\1\2\3\4\5\6\7\x08"),
    Frame(0x000, b"\x01\x00"),
    Frame(0x7FF, b""),
    Frame(0x18DA10F1, b"\xaa\xbb", flags=EXTENDED),
    Frame(0x123, bytes(4), flags=RTR),
    Frame(0x181, bytes(8), flags=EXTENDED),
    Frame(0x701, b"\x05"),
]
