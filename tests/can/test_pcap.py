"""Captures: whatever frame is written, Wireshark's reader gives it back, value by value."""

import io
import json
import random
import shutil
import struct
import subprocess

import pytest

from skinbus.can.frame import BRS, ERROR, ESI, EXTENDED, FD, RTR, Frame, FrameBatch
from skinbus.can.pcap import PcapngWriter, PcapWriter

NEEDS_TSHARK = pytest.mark.skipif(
    shutil.which("tshark") is None, reason="install tshark (apt-get install tshark)"
)


ERROR_CLASSES = ["tx_timeout", "lostarb", "ctrl", "prot", "trx", "ack", "busoff", "buserror", "restarted"]
"""Bits of the identifier of an error frame, as tshark calls them."""


def some_frames(seed):
    """Frames of all kinds in random order, on three buses."""
    rng = random.Random(seed)
    frames = []
    for k in range(400):
        kind = rng.choice([0, EXTENDED, RTR, RTR | EXTENDED, FD, FD | BRS, FD | BRS | ESI | EXTENDED, ERROR])
        longest = rng.choice([0, 1, 8, 12, 48, 64]) if kind & FD else rng.randrange(9)
        data = bytes(longest) if kind & RTR else rng.randbytes(8 if kind == ERROR else longest)
        can_id = rng.randrange(1 << 29 if kind & EXTENDED else 0x200 if kind == ERROR else 1 << 11)
        frames.append(
            Frame(can_id, data, 1_795_263_452_171_891_123 + k * 999_999_937, kind, rng.randrange(3))
        )
    return frames


def columns(frames):
    batch = FrameBatch(len(frames))
    assert batch.extend(frames) == len(frames)
    return batch.frames, batch.t_ns


def dissected(path):
    """The frames of a capture as tshark reads them, and the names of their interfaces."""
    run = subprocess.run(
        ["tshark", "-r", path, "-T", "json", "-x"], capture_output=True, text=True, check=True
    )
    frames, names = [], []
    for packet in json.loads(run.stdout):
        layers = packet["_source"]["layers"]
        raw = bytes.fromhex(layers["frame_raw"][0])
        can = layers.get("can") or layers["canfd"]
        is_error, is_remote = (can.get(f"can.flags.{kind}") == "1" for kind in ("err", "rtr"))
        flags = EXTENDED if can.get("can.flags.xtd") == "1" else 0
        flags |= (ERROR if is_error else 0) | (RTR if is_remote else 0)
        if "canfd" in layers:
            flags |= FD | (BRS if can["canfd.flags.brs"] == "1" else 0)
            flags |= ESI if can["canfd.flags.esi"] == "1" else 0
        length = int(can["can.len"])
        data = bytes(length) if is_remote else raw[8 : 8 + length]
        assert len(raw) == 8 + (0 if is_remote else length)
        classes = sum((can.get(f"can.err.{name}") == "1") << k for k, name in enumerate(ERROR_CLASSES))
        can_id = classes if is_error else int(can["can.id"], 0)
        seconds, _, fraction = layers["frame"]["frame.time_epoch"].partition(".")
        frames.append(Frame(can_id, data, int(seconds) * 10**9 + int(fraction.ljust(9, "0")), flags))
        names.append(layers["frame"].get("frame.interface_id_tree", {}).get("frame.interface_name"))
    return frames, names


@NEEDS_TSHARK
def test_every_frame_of_a_pcap_is_read_by_tshark(tmp_path):
    frames = some_frames(20_112)
    path = tmp_path / "some.pcap"
    with path.open("wb") as file:
        writer = PcapWriter(file)
        for k in range(0, len(frames), 150):
            writer.write(*columns(frames[k : k + 150]))
    found, _ = dissected(path)
    assert found == [frame._replace(bus=0) for frame in frames]


@NEEDS_TSHARK
def test_a_pcapng_holds_several_interfaces_by_their_names(tmp_path):
    frames = some_frames(31_877)
    path = tmp_path / "some.pcapng"
    names = ["can0", "vcan-left", "x"]
    with path.open("wb") as file:
        writer = PcapngWriter(file)
        for k in range(0, len(frames), 150):
            writer.write(*columns(frames[k : k + 150]), names)
    found, interfaces = dissected(path)
    assert found == [frame._replace(bus=0) for frame in frames]
    assert interfaces == [names[frame.bus] for frame in frames]


def test_a_pcap_is_what_the_documents_say():
    """By hand, against the drafts: the file's head, one packet's head, and struct can_frame."""
    file = io.BytesIO()
    PcapWriter(file).write(*columns([Frame(0x581, b"\x11\x22", 3_000_000_007)]))
    head, packet = file.getvalue()[:24], file.getvalue()[24:]
    assert struct.unpack("<IHHiIII", head) == (0xA1B23C4D, 2, 4, 0, 0, 72, 227)
    assert struct.unpack("<4I", packet[:16]) == (3, 7, 10, 10)
    assert packet[16:] == bytes.fromhex("00000581 02000000 1122")


def test_nothing_is_a_capture_too():
    for writer in (PcapWriter(io.BytesIO()), PcapngWriter(io.BytesIO())):
        writer.write(*columns([]), *([["can0"]] if isinstance(writer, PcapngWriter) else []))
