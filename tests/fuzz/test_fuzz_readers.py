"""Hostile files and datagrams: every reader either takes them or refuses them in its own words, soon."""

import time
from collections import Counter

import can
import numpy as np
import pytest

from skinbus.bus.udp_multicast import pack_datagram, unpack_datagram
from skinbus.can.candump import CandumpReader
from skinbus.cli.press_csv import read_columns, read_presses
from skinbus.config.arm_file import find_arm
from skinbus.config.state_file import StateFile
from skinbus.config.system import load_arm
from skinbus.config.toml_file import read_toml
from skinbus.errors import SkinbusError
from skinbus.objects.eds import find_eds, load_eds
from skinbus.sim.scene_file import SCENES, load_scene

SEED = 20260102
MAX_S = 5.0
"""On a machine that is busy; it is a second alone."""

WORDS = [
    *(b"[", b"]", b"{", b"}", b'"""', b"'''", b'"', b"'", b"=", b".", b"\n", b"\r\n", b"\x00", b"\xff"),
    *(b"#", b";", b",", b"0x", b"9" * 50, b"1e308", b"5e-324", b"-1", b"nan", b"inf", b"$NODEID", b"true"),
    *(b"[[patch]]", b"[1018sub1]", b"\xef\xbb\xbf", "\u202e".encode(), b"\x1b[2J", b"(1.0) can0 123#"),
    *(b"a." * 30, b"[" * 30, b"\n1,2,3,4,5,6"),
]
COUNTS = [",".join(str(100 * press + k) for k in range(16)) for press in range(4)]
PRESSES = "node_id,s_mm,a_mm,force_n," + ",".join(f"p{k + 1}" for k in range(16)) + ",bus\n"
PRESSES += "".join(
    f"1,{10 + n},{n},{0.5 * n},{counts},{('upper', 'lower')[n % 2]}\n" for n, counts in enumerate(COUNTS)
)
POSES = "t_s,s_mm,a_mm,force_n\n" + "".join(f"{0.1 * k:.1f},{10 + k},{k % 3},{0.5 * k}\n" for k in range(12))
LOG = "".join(f"({k}.000000) can0 {0x181 + k:03X}#00112233445566{k:02X}\n" for k in range(20))
LOG += "(21.0) can0 00000123##1AABB\n(22.0) can0 123#R4\n(23.0) can0 20000080#0001000000000000\n"
MESSAGES = [
    can.Message(arbitration_id=0x181, is_extended_id=False, data=bytes(8), channel="0011"),
    can.Message(arbitration_id=0x80, is_extended_id=False, is_remote_frame=True, dlc=4),
    can.Message(arbitration_id=0x1FFF_FFFF, data=bytes(64), is_fd=True, bitrate_switch=True),
]


def readers(folder):
    """All readers, and the contents that mutations begin from."""
    pad, two = load_arm("pad"), load_arm("arm-two-buses")
    arm, eds = find_arm("pad").read_bytes(), find_eds("skin-patch-8bit").read_bytes()
    StateFile(folder / "state").save({"patches": {"/1": {"zero_Pa": [1.0] * 16}}, "contacts": []})
    head = eds[: eds.index(b"[1018]")]
    columns = [("t_s", "s_mm", "a_mm")], ["force_n"]
    return {
        "toml": (read_toml, arm),
        "arm": (load_arm, arm),
        "two buses": (load_arm, find_arm("arm-two-buses").read_bytes()),
        "scene": (load_scene, (SCENES / "pad.toml").read_bytes()),
        "eds": (lambda path: load_eds(path, 1), head),
        "dcf": (lambda path: load_eds(path, 1), head + b"[DeviceComissioning]\nNodeID=1\n"),
        "presses": (lambda path: read_presses(pad, path), PRESSES.encode()),
        "presses of buses": (lambda path: read_presses(two, path), PRESSES.encode()),
        "poses": (lambda path: read_columns(path, *columns), POSES.encode()),
        "candump": (lambda path: list(CandumpReader(path)), LOG.encode()),
        "state": (lambda path: StateFile(path).load(), (folder / "state").read_bytes()),
        **{
            f"datagram {n}": (lambda path: unpack_datagram(path.read_bytes()), pack_datagram(message))
            for n, message in enumerate(MESSAGES)
        },
    }


def mutate(rng, content):
    """Change, cut, double and insert a few pieces."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 6)):
        at = int(rng.integers(0, len(data) + 1))
        match rng.integers(0, 6):
            case 0 if data:
                data[min(at, len(data) - 1)] = int(rng.integers(0, 256))
            case 1:
                del data[at : at + int(rng.integers(1, 40))]
            case 2:
                data[at:at] = data[at : at + int(rng.integers(1, 200))]
            case 3:
                del data[at:]
            case 4:
                word = WORDS[rng.integers(0, len(WORDS))]
                data[at:at] = word * int(rng.integers(1, 3) if rng.random() < 0.95 else 3000)
            case _:
                data[at : at + 4] = rng.bytes(4)
    return bytes(data)


@pytest.mark.slow
def test_no_input_raises_what_is_not_ours_or_takes_long(tmp_path):
    rng, path, slowest = np.random.default_rng(SEED), tmp_path / "input.eds", Counter()
    for kind, (read, start) in readers(tmp_path).items():
        for _ in range(100):
            content = mutate(rng, start)
            path.write_bytes(content)
            begin = time.process_time()
            try:
                read(path)
            except SkinbusError as error:
                said = str(error)
                assert said.replace("\n", "").isprintable(), ascii(said)
                assert len(said) < 100_000
            except Exception as error:
                raise AssertionError(f"{kind}: {content[:2000]!r}") from error
            slowest[kind] = max(slowest[kind], time.process_time() - begin)
    assert max(slowest.values()) < MAX_S, slowest
