"""Mutants of the firmware: faults that real boards have, compiled and put through the check of a board."""

import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinbus.can.core import Step
from skinbus.can.virtual_bus import VirtualBus
from skinbus.firmware import write_project
from skinbus.master.commissioning.patch_check import RULES, Grade, PatchCheck
from skinbus.node.context import NS_PER_MS
from skinbus.node.layout import ImageLayout
from skinbus.objects.eds import load_eds
from tests.files import put
from tests.firmware.firmware_device import EMPTY, FLAGS, PORT, Code, FirmwareDevice

NODE = 5
LIMIT_NS = 300_000 * NS_PER_MS
POLL_NS = NS_PER_MS // 10
"""How long a port sleeps at least."""


@dataclass(frozen=True)
class Mutant:
    """A change of one file, and why the check does not find it, if it need not."""

    name: str
    file: str
    old: str
    new: str
    reason: str


def load_mutants():
    """All mutants of the table."""
    text = (Path(__file__).parent / "mutants.txt").read_text()
    for block in text.split("\n# ")[1:]:
        name, file, *lines = block.rstrip("\n").split("\n")
        old, new, reason = ([line[2:] for line in lines if line[:2] == f"{mark} "] for mark in "<>=")
        yield Mutant(name, file, "\n".join(old), "\n".join(new), " ".join(reason))


class Workshop:
    """The objects of the unchanged firmware, and mutants linked from them."""

    def __init__(self, folder):
        self.folder, self.n = folder, 0
        write_project("skin-patch", folder)
        self.layout = ImageLayout(load_eds("skin-patch", NODE), 1)
        flags = [flag for flag in FLAGS if not flag.startswith("-W")]
        self.compile = ["cc", *flags, "-w", "-fPIC", f"-I{folder}", f"-I{folder / 'core'}"]
        self.sources = [*sorted(folder.glob("core/*.c")), folder / "board.c", PORT]
        for source in self.sources:
            self.run(*self.compile, "-O1", "-c", source, "-o", folder / f"{source.stem}.o")

    def run(self, *command):
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
        assert not done.returncode, done.stderr

    def make(self, mutant):
        """Compile a mutant."""
        self.n += 1
        source = self.folder / "core" / mutant.file
        text = source.read_text()
        assert text.count(mutant.old) == 1, f"{mutant.name}: {text.count(mutant.old)} places"
        own = put(self.folder, f"mutant-{self.n}.c", text.replace(mutant.old, mutant.new))
        others = [self.folder / f"{s.stem}.o" for s in self.sources if s != source]
        library = own.with_suffix(".so")
        self.run(*self.compile, "-shared", own, *others, "-o", library)
        return Code(library, self.layout)


class SensingFirmware(FirmwareDevice):
    """A board with noise and zeros of its own; after ``press`` a finger is on it."""

    def __init__(self, code):
        super().__init__(code, NODE, flash=bytearray(EMPTY))
        self.rng = np.random.default_rng(5)
        self.pressure = np.zeros(16)
        self.zero = self.rng.integers(-60, 60, 16)

    def press(self, text):
        self.pressure = 9000.0 * np.exp(-0.5 * (np.arange(16) - 6.0) ** 2 / 4.0)

    def step(self, now_ns, frames=()):
        if any(frame.can_id in (0x80, 0x600 + NODE) for frame in frames):
            self.readings[:] = self.zero + self.pressure + self.rng.normal(0.0, 8.0, 16)
        sent, events, wake_ns = super().step(now_ns, frames)
        return Step(sent, events, max(wake_ns, now_ns + POLL_NS))


def broken_rules(device, eds="skin-patch", **settings):
    """Return the first rule that a board breaks, and what was seen."""
    wire = VirtualBus(1_000_000, data_bitrate=2_000_000)
    wire.attach(device)
    od = load_eds(eds, NODE)
    core = PatchCheck(NODE, od, 5 * NS_PER_MS, RULES, destructive=True, **settings)
    wire.attach(core)
    for until_ns in range(0, LIMIT_NS, 1000 * NS_PER_MS):
        wire.run(until_ns)
        found = {r.rule.name: r.detail for r in core.results if r.grade is Grade.FAIL}
        if found or len(core.results) == len(RULES):
            return found
    return {"it ends": "the check did not end"}
