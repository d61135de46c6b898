"""Wireshark's dissector reads our recordings and names every frame of boot, cycle and fault as what it is."""

import re
import shutil
import subprocess

import pytest

from skinbus.can.candump import CandumpWriter
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.errors import SdoAborted
from skinbus.master import Master
from skinbus.node import Device
from skinbus.objects.eds import load_eds
from skinbus.sim import World, load_scene
from tests.interop.session import SdoSession

PATCH, MASTER = 5, 127

NEEDS_TSHARK = pytest.mark.skipif(
    shutil.which("tshark") is None, reason="install tshark (apt-get install tshark)"
)

# Identifiers from, identifiers to, first bytes of the data (a pattern on its hexadecimal text), name.
# A CiA 301 bus; contacts travel on identifiers of our own, which the dissector rightly does not know.
NAMES = [
    (0x000, 0x000, "01", "NMT: Start remote node"),
    (0x000, 0x000, "02", "NMT: Stop remote node"),
    (0x000, 0x000, "80", "NMT: Enter pre-operational state"),
    (0x000, 0x000, "81", "NMT: Reset node"),
    (0x000, 0x000, "82", "NMT: Reset communication"),
    (0x080, 0x080, "(..)?", "SYNC"),
    (0x081, 0x0FF, "", "EMCY"),
    *((0x181 + 0x100 * k, 0x1FF + 0x100 * k, "", rf"PDO{k + 1} \(tx\)") for k in range(4)),
    (0x581, 0x5FF, "4", r"Default-SDO \(tx\): Initiate upload response"),
    (0x581, 0x5FF, "[01]", r"Default-SDO \(tx\): Upload segment response"),
    (0x581, 0x5FF, "6", r"Default-SDO \(tx\): Initiate download response"),
    (0x581, 0x5FF, "[23]0", r"Default-SDO \(tx\): Download segment response"),
    (0x581, 0x5FF, "80", r"Default-SDO \(tx\): Abort transfer"),
    (0x601, 0x67F, "40", r"Default-SDO \(rx\): Initiate upload request"),
    (0x601, 0x67F, "[67]0", r"Default-SDO \(rx\): Upload segment request"),
    (0x601, 0x67F, "2", r"Default-SDO \(rx\): Initiate download request"),
    (0x601, 0x67F, "[01]", r"Default-SDO \(rx\): Download segment request"),
    (0x681, 0x690, "", r"Unknown \(13\)"),
    (0x701, 0x77F, "00", "NMT Error Control: Boot-up"),
    (0x701, 0x77F, "04", "NMT Error Control: Stopped"),
    (0x701, 0x77F, "05", "NMT Error Control: Operational"),
    (0x701, 0x77F, "7f", "NMT Error Control: Pre-operational"),
]


def name_of(frame):
    """What the dissector has to say of a frame."""
    for first, last, data, name in NAMES:
        if first <= frame.can_id <= last and re.match(data, frame.data.hex()):
            return name
    raise AssertionError(f"the table does not hold {frame}")


def dissect(path):
    """What tshark says of each frame."""
    run = subprocess.run(
        ["tshark", "-r", path, "-d", "can.subdissector,canopen", "-o", 'gui.column.format:"Info","%i"'],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return [line.strip() for line in run.stdout.splitlines()]


def boot_cycle_and_fault(path):
    """Record a patch and a master through all they do; the frames recorded."""
    wire = VirtualBus()
    frames = []
    wire.tap(frames.append)
    patch = Device(load_eds("skin-patch", PATCH), PATCH)
    master = Device(load_eds("skin-master", MASTER), MASTER)
    with CandumpWriter(path) as writer:
        wire.tap(writer)
        patch_port, master_port = wire.attach(patch), wire.attach(master)
        session = SdoSession(PATCH, None, wire)
        # Boot: identity, segments both ways, a heartbeat, something refused, the start.
        for sub in range(5):
            session.read(0x1018, sub)
        session.read(0x1008, 0)
        session.write(0x2040, 0, bytes(range(8)))
        session.write(0x1017, 0, (50).to_bytes(2, "little"))
        for index, data in ((0x5FFF, b"\0"), (0x1008, b"a longer name")):
            with pytest.raises(SdoAborted):
                session.write(index, 0, data)
        wire.run(200_000_000)
        # Cycles, with readings and contacts.
        session.frames_of_two_syncs()
        for number in range(1, 18):
            master.transmit_tpdo(number)
        wire.wake(master_port)
        wire.run(400_000_000)
        # A fault comes and goes; every NMT command; the patch falls silent.
        patch.emcy(0x5000, 0x01, b"\x01")
        wire.wake(patch_port)
        wire.run(500_000_000)
        patch.emcy_clear(0x5000)
        for command in (0x80, 0x01, 0x02, 0x82, 0x81):
            session.send(Frame(0x000, bytes([command, PATCH])))
            wire.run(wire.now_ns + 60_000_000)
        wire.detach(patch_port)
        wire.run(1_000_000_000)
    assert writer.n_frames == len(frames)
    return frames


def whole_pipeline(path):
    """Record a scene with its master for a while, a pulled patch included; the frames recorded."""
    scene = load_scene("pad")
    wire = VirtualBus(scene.arm.bus.bitrate)
    frames = []
    wire.tap(frames.append)
    with CandumpWriter(path) as writer:
        wire.tap(writer)
        wire.attach(Master(scene.arm))
        port = wire.attach(World(scene))
        wire.run(2_000_000_000)
        wire.detach(port)
        wire.run(3_000_000_000)
        wire.restart(port)
        wire.run(4_000_000_000)
    return frames


def check_names(frames, path):
    """Every frame has the name that the table gives it, and nothing is malformed."""
    said = dissect(path)
    assert len(said) == len(frames)
    wrong = [
        (frame, info) for frame, info in zip(frames, said, strict=True) if not re.match(name_of(frame), info)
    ]
    assert wrong == []
    assert [info for info in said if "Malformed" in info] == []


@pytest.mark.slow
@NEEDS_TSHARK
def test_scene_and_master_are_named_and_nothing_is_malformed(tmp_path):
    path = tmp_path / "pipeline.log"
    check_names(whole_pipeline(path), path)


@NEEDS_TSHARK
def test_every_kind_of_frame_is_named_and_none_is_malformed(tmp_path):
    path = tmp_path / "bus.log"
    frames = boot_cycle_and_fault(path)
    check_names(frames, path)
    names = {name_of(frame) for frame in frames}
    missing = {name for *_, name in NAMES} - names
    assert not missing, f"the recording lacks {sorted(missing)}"


@NEEDS_TSHARK
def test_dissector_does_find_what_is_malformed(tmp_path):
    # Otherwise the test above says nothing.
    path = tmp_path / "bad.log"
    with CandumpWriter(path) as writer:
        for frame in (Frame(0x605, b"\x40\x00\x10"), Frame(0x085, b"\x00\x50")):
            writer(frame)
    assert all("Malformed" in info for info in dissect(path))
