"""Hostile files and datagrams: every reader either takes them or refuses them in its own words, soon.

``python -m tests.fuzz.fuzz_readers 1000000`` mutates inputs of all kinds a million times; a number after that
is the seed, words after it are the kinds to feed alone. Prints the slowest input and the largest memory.
"""

import resource
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import can
import numpy as np

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

MAX_S = 1.0
MAX_BYTES = 100 << 20

WORDS = [
    *(b"[", b"]", b"{", b"}", b'"""', b"'''", b'"', b"'", b"=", b".", b"\n", b"\r\n", b"\x00", b"\xff"),
    *(b"#", b";", b",", b"0x", b"9" * 50, b"1e308", b"5e-324", b"-1", b"nan", b"inf", b"$NODEID", b"true"),
    *(b"[[patch]]", b"[1018sub1]", b"\xef\xbb\xbf", "\u202e".encode(), b"\x1b[2J", b"(1.0) can0 123#"),
    *(b"a." * 30, b"[" * 30, b"\n1,2,3,4,5,6"),
]
TACTELS = range(16)
PRESSES = "node_id,s_mm,a_mm,force_n," + ",".join(f"c{k + 1}" for k in TACTELS) + ",bus\n"
for press in range(4):
    counts = ",".join(str(100 * press + k) for k in TACTELS)
    PRESSES += f"1,{10 + press},{press},{0.5 * press},{counts},{('upper', 'lower')[press % 2]}\n"
POSES = "t_s,s_mm,a_mm,force_n\n" + "".join(f"{0.1 * k:.1f},{10 + k},{k % 3},{0.5 * k}\n" for k in range(12))
LOG = "".join(f"({k}.000000) can0 {0x181 + k:03X}#00112233445566{k:02X}\n" for k in range(20))
LOG += "(21.0) can0 00000123##1AABB\n(22.0) can0 123#R4\n(23.0) can0 20000080#0001000000000000\n"


def read_eds(path):
    """All of an EDS, as a patch of an arm brings it in."""
    load_eds(path, 1)


def read_log(path):
    """All lines of a recording."""
    for _ in CandumpReader(path):
        pass


class Readers:
    """All readers, each with the contents that mutations begin from."""

    def __init__(self, folder: Path) -> None:
        pad, two = load_arm("pad"), load_arm("arm-two-buses")
        arm, eds = find_arm("pad").read_bytes(), find_eds("skin-patch-8bit").read_bytes()
        StateFile(folder / "state").save({"patches": {"/1": {"zero_Pa": [1.0] * 16}}, "contacts": []})
        state = (folder / "state").read_bytes()
        head = eds[: eds.index(b"[1018]")]
        self.files = {
            "toml": (read_toml, arm),
            "arm": (load_arm, arm),
            "two buses": (load_arm, find_arm("arm-two-buses").read_bytes()),
            "scene": (load_scene, (SCENES / "pad.toml").read_bytes()),
            "eds": (read_eds, head),
            "dcf": (read_eds, head + b"[DeviceComissioning]\nNodeID=1\n"),
            "presses": (lambda path: read_presses(pad, path), PRESSES.encode()),
            "presses of buses": (lambda path: read_presses(two, path), PRESSES.encode()),
            "poses": (
                lambda path: read_columns(path, [("t_s", "s_mm", "a_mm")], ["force_n"]),
                POSES.encode(),
            ),
            "candump": (read_log, LOG.encode()),
            "state": (lambda path: StateFile(path).load(), state),
        }
        messages = [
            can.Message(arbitration_id=0x181, is_extended_id=False, data=bytes(8), channel="0011"),
            can.Message(arbitration_id=0x80, is_extended_id=False, is_remote_frame=True, dlc=4),
            can.Message(arbitration_id=0x1FFF_FFFF, data=bytes(64), is_fd=True, bitrate_switch=True),
        ]
        self.datagrams = [pack_datagram(message) for message in messages]
        self.path = folder / "input.eds"
        self.slowest = Counter()

    def beginning(self, kind: str, k: int) -> bytes:
        """Return what a mutation begins from."""
        return self.datagrams[k // 7 % len(self.datagrams)] if kind == "datagram" else self.files[kind][1]

    def read(self, kind: str, content: bytes) -> None:
        """Read one input; errors that are not ours, and those whose message could be obeyed, go on."""
        begin = time.process_time()
        if kind == "datagram":
            unpack_datagram(content)
        else:
            self.path.write_bytes(content)
            try:
                self.files[kind][0](self.path)
            except SkinbusError as error:
                said = str(error)
                assert said.replace("\n", "").isprintable(), ascii(said)
                assert len(said) < 100_000
        self.slowest[kind] = max(self.slowest[kind], time.process_time() - begin)


def mutate(rng: np.random.Generator, content: bytes) -> bytes:
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


def fuzz(n: int, seed: int, only: Sequence[str] = ()) -> Readers:
    """Feed ``n`` inputs to all readers in turn, or only to some."""
    rng = np.random.default_rng(seed)
    with TemporaryDirectory() as folder:
        readers = Readers(Path(folder))
        kinds = [*only] or [*readers.files, *["datagram"] * 4]  # a datagram costs a hundredth of a file
        for k in range(n):
            if k % 50_000 == 49_999:
                print(f"{k + 1} of {n} inputs, slowest {max(readers.slowest.values()):.3f} s", flush=True)
            kind = kinds[k % len(kinds)]
            content = mutate(rng, readers.beginning(kind, k))
            try:
                readers.read(kind, content)
            except Exception as error:
                raise AssertionError(f"seed {seed}, input {k}, {kind}: {content[:2000]!r}") from error
    return readers


if __name__ == "__main__":
    n, seed = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000, int(sys.argv[2]) if len(sys.argv) > 2 else 0
    fuzz(100, seed, sys.argv[3:])  # what is imported at the first inputs is no input's
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = fuzz(n, seed, sys.argv[3:])
    for kind, seconds in sorted(found.slowest.items()):
        print(f"{kind:10} slowest {seconds:.3f} s")
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(f"{n} inputs, memory grew by {grown >> 10} MB")
    sys.exit(any(seconds > MAX_S for seconds in found.slowest.values()) or grown << 10 > MAX_BYTES)
