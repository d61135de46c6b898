"""Captures for Wireshark: columns of frames as pcap or pcapng, link type CAN_SOCKETCAN (227).

A frame is stored as the kernel's ``struct can_frame`` or ``canfd_frame``, with the identifier and its flags
in network byte order, times in nanoseconds. pcap holds one interface and has no name for it; pcapng holds
several with their names.

Sources: https://www.tcpdump.org/linktypes/LINKTYPE_CAN_SOCKETCAN.html, draft-ietf-opsawg-pcap and -pcapng.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt

from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, MAX_DATA, RTR

LINKTYPE_CAN_SOCKETCAN: Final = 227
SNAP_LENGTH: Final = 8 + MAX_DATA
"""Bytes of the longest packet."""

PCAP_MAGIC: Final = 0xA1B2_3C4D
"""Of a pcap file with times in nanoseconds."""
PCAPNG_MAGIC: Final = 0x0A0D_0D0A

_EFF, _RTR, _ERR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_BRS, _ESI, _FDF = 0x01, 0x02, 0x04
_NS_PER_S: Final = 1_000_000_000

Bytes = npt.NDArray[np.uint8]


class PcapWriter:
    """Writes the frames of one interface as pcap."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        file.write(struct.pack("<IHHiIII", PCAP_MAGIC, 2, 4, 0, 0, SNAP_LENGTH, LINKTYPE_CAN_SOCKETCAN))

    def write(self, frames: npt.NDArray[Any], t_ns: npt.NDArray[np.int64]) -> None:
        """Write frames, (n,) of FRAME_DTYPE, with their times, whatever bus they are on."""
        packets, lengths = _packets(frames)
        heads = np.empty((len(frames), 4), "<u4")
        heads[:, 0], heads[:, 1] = t_ns // _NS_PER_S, t_ns % _NS_PER_S
        heads[:, 2] = heads[:, 3] = lengths
        self._file.write(_joined(heads.view(np.uint8), packets, lengths, 0))


class PcapngWriter:
    """Writes the frames of several interfaces, by their names, as pcapng."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._n_interfaces = 0
        file.write(_block(PCAPNG_MAGIC, struct.pack("<IHHq", 0x1A2B_3C4D, 1, 0, -1)))

    def write(self, frames: npt.NDArray[Any], t_ns: npt.NDArray[np.int64], channels: Sequence[str]) -> None:
        """Write frames with their times; ``channels`` are the names of their buses by number."""
        for channel in channels[self._n_interfaces :]:
            name = channel.encode()
            options = struct.pack("<HH", 2, len(name)) + name + bytes(-len(name) % 4)
            options += struct.pack("<HHB3x", 9, 1, 9) + bytes(4)  # if_tsresol: nanoseconds; end of options
            body = struct.pack("<HHI", LINKTYPE_CAN_SOCKETCAN, 0, SNAP_LENGTH) + options
            self._file.write(_block(1, body))
        self._n_interfaces = max(self._n_interfaces, len(channels))
        packets, lengths = _packets(frames)
        heads = np.empty((len(frames), 7), "<u4")
        heads[:, 0], heads[:, 1] = 6, 32 + lengths + -lengths % 4  # an Enhanced Packet Block
        heads[:, 2] = frames["bus"]
        heads[:, 3], heads[:, 4] = t_ns >> 32, t_ns & 0xFFFF_FFFF
        heads[:, 5] = heads[:, 6] = lengths
        self._file.write(_joined(heads.view(np.uint8), packets, lengths, 4))


def _block(kind: int, body: bytes) -> bytes:
    size = 12 + len(body)
    return struct.pack("<II", kind, size) + body + struct.pack("<I", size)


def _packets(frames: npt.NDArray[Any]) -> tuple[Bytes, npt.NDArray[np.int64]]:
    """Return frames as packets, (n, SNAP_LENGTH), and how many bytes of each count, (n,)."""
    flags = frames["flags"]
    is_fd = (flags & FD) > 0
    words = frames["can_id"].astype(np.uint32)
    for ours, theirs in ((EXTENDED, _EFF), (RTR, _RTR), (ERROR, _ERR)):
        words |= np.where(flags & ours, np.uint32(theirs), np.uint32(0))
    packets = np.zeros((len(frames), SNAP_LENGTH), np.uint8)
    packets[:, :4] = words.astype(">u4").view(np.uint8).reshape(-1, 4)
    packets[:, 4] = frames["length"]
    packets[:, 5] = np.where(is_fd, _FDF, 0)
    packets[:, 5] |= np.where(flags & BRS, _BRS, 0).astype(np.uint8)
    packets[:, 5] |= np.where(flags & ESI, _ESI, 0).astype(np.uint8)
    packets[:, 8:] = frames["data"]
    # a remote frame has the length that it asks for, and no data
    return packets, 8 + np.where(flags & RTR, 0, frames["length"]).astype(np.int64)


def _joined(heads: Bytes, packets: Bytes, lengths: npt.NDArray[np.int64], trailer: int) -> bytes:
    """Return head, packet and for pcapng (``trailer``) padding and the length again, record after record."""
    padded = lengths + (-lengths % 4 if trailer else 0)
    size = heads.shape[1] + padded + trailer
    ends = np.cumsum(size)
    out = np.zeros(int(ends[-1]) if len(ends) else 0, np.uint8)
    for length in np.unique(lengths).tolist():  # at most 65
        rows = np.flatnonzero(lengths == length)
        at = (ends - size)[rows, None]
        out[at + np.arange(heads.shape[1])] = heads[rows]
        out[at + heads.shape[1] + np.arange(length)] = packets[rows, :length]
        if trailer:
            out[(ends - trailer)[rows, None] + np.arange(trailer)] = heads[rows, 4:8]
    return out.tobytes()
