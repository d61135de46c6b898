"""The conformance table: rows of frames in and frames out, from bytes to bytes; how they are read and run.

Files in ``conformance`` hold rows: ``# name | section of the CiA document | on=patch state=op node_id=255``,
and steps, with a note after ``;``::

    -> 600+n 40 00 10 00 00 00 00 00   frame to the device
    => 700+n                            remote frame to the device
    <- 580+n 43 00 10 00 91 01 04 00   the next frame of the device, exactly; all it sends must be listed
    -- 700+n                            the device does not listen to this identifier in its state
    ++ 500                              milliseconds pass on the virtual clock
    power                               off and on again, with the same storage
    read 1000:00 = 91 01 04 00          an expedited upload, with ! an abort code
    write 1015:00 64 00                 an expedited download, with ! an abort code
    set 1017:00 100                     the device's own program, or its host, acts: see ``Actions``

Identifiers and bytes are hexadecimal; ``n`` is the node-ID, also as a byte ``nn``.
"""

from ast import literal_eval
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from skinbus.can.clock import VirtualClock
from skinbus.can.core import NEVER, receives
from skinbus.can.frame import RTR, Frame
from skinbus.gateway.reader import Reader
from skinbus.node import Device, PatchHost
from skinbus.objects.cia import (
    HEARTBEAT_PRODUCER,
    IDENTITY,
    IDENTITY_SERIAL,
    SYNC_PERIOD,
    AbortCode,
    NmtCommand,
    NmtState,
)
from skinbus.objects.eds import load_eds
from skinbus.objects.guard import NO_LIMIT, GuardLimits
from skinbus.objects.profile import AGE_STEP_NS, SampleStatus
from tests.firmware.firmware_device import EMPTY, FirmwareDevice, code_of
from tests.firmware.images import make_image

NS_PER_MS = 1_000_000
shared_eds = cache(load_eds)
"""A device does not write to its dictionary."""
SERIAL = 0x00C0FFEE
DEVICES = dict.fromkeys(("patch", "hosted", "firmware"), ("skin-patch", 5))
DEVICES["master"] = ("skin-master", 127)
"""A device by itself, in a host that has its readings from a reader, as firmware, and the master's."""

To = {"pre": NmtCommand.PRE_OPERATIONAL, "op": NmtCommand.START, "stopped": NmtCommand.STOP}


class BrokenStorage(dict):
    """A memory that cannot be written."""

    def __setitem__(self, group, text):
        raise OSError("write protected")

    pop = __setitem__


class DamagedStorage(dict):
    """A memory whose content has rotted."""

    def get(self, group):
        return "skinbus parameters 1 534B4E42 00005001\n1015:00 6400\n00000000\n"


STORAGES = {"": dict, "none": lambda: None, "broken": BrokenStorage, "damaged": DamagedStorage}
FLASHES = {"": lambda: bytearray(EMPTY), "none": lambda: None, "damaged": lambda: bytearray(len(EMPTY))}
FLASHES["broken"] = FLASHES[""]


@dataclass(frozen=True)
class Row:
    """One rule: its name, the section of the CiA document, the steps, and what it starts with."""

    name: str
    section: str
    steps: Sequence[str]
    on: str
    flags: Sequence[str]
    """Of the compiler of firmware."""
    state: str = "pre"
    node_id: str = "0"
    storage: str = ""

    def __str__(self):
        return self.name


def load_rows():
    """All rows of all files."""
    for path in sorted((Path(__file__).parent / "conformance").glob("*.txt")):
        # the firmware refuses block transfers as commands that it does not know
        # whoever has no host is told of no samples
        boards = {"sdo_block": "patch,hosted", "guard": "hosted,firmware"}
        for text in path.read_text().split("\n# ")[1:]:
            head, *steps = text.strip().split("\n")
            name, section, *options = (part.strip() for part in head.split("|"))
            said = dict(option.split("=") for option in " ".join(options).split())
            patch = boards.get(path.stem, "patch,hosted,firmware")
            said["on"] = said.get("on", "patch,master").replace("patch", patch)
            # rows of the guard have its period, all others a sample with every step
            flags = ["-USB_PERIOD_US"] if path.stem == "guard" else []
            yield Row(name, section, [line for step in steps for line in expand(step)], flags=flags, **said)


def expand(step):
    """The frames of a step that reads or writes, else the step."""
    verb, _, rest = step.partition(" ")
    if verb not in ("read", "write"):
        return (step,)
    place, _, rest = rest.partition(" ")
    text, _, code = rest.partition("! ")
    data = bytes.fromhex(text.removeprefix("= "))
    size = 4 - len(data) << 2
    if verb == "read":
        asked, answer = sdo("-> 600+n", 0x40, place), sdo("<- 580+n", 0x43 | size, place, data)
    else:
        asked, answer = sdo("-> 600+n", 0x23 | size, place, data), sdo("<- 580+n", 0x60, place)
    return asked, sdo("<- 580+n", 0x80, place, int(code, 16).to_bytes(4, "little")) if code else answer


def sdo(way, command, place, data=b""):
    """The step of an SDO frame that carries up to four bytes."""
    index, _, sub = place.partition(":")
    return f"{way} {command:02X} {index[2:]} {index[:2]} {sub} {data.ljust(4, bytes(1)).hex(' ')}"


class Actions:
    """What the own program of a device, or its host, does in a step, beside what the device can itself."""

    def __init__(self, bench):
        self.bench = bench
        self.heard = []
        """What the application saw of writes."""

    @property
    def device(self):
        return self.bench.device

    def act(self, words):
        name, *rest = words
        named = dict(word.split("=") for word in rest if "=" in word)
        arguments = [argument(word) for word in rest if "=" not in word]
        method = getattr(self, name, None) or getattr(self.device, name)
        method(*arguments, **{key: argument(word) for key, word in named.items()})

    def boot(self):
        pass

    def start(self):
        self.device.command(NmtCommand.START)

    def set(self, place, value):
        self.device.set(*place, value)

    def sample(self, *readings):
        self.bench.sample(readings)

    def halt(self):
        self.bench.is_sampling = False

    def resume(self):
        self.bench.is_sampling = True

    def limits(
        self, limit=NO_LIMIT, weight=0, sum=2**31 - 1, rest=0, n=1, m=1, tactel=0, tactels=16, spoilt=-1
    ):
        """The master writes limits, the same for all tactels or for one; of an answer a refusal is left.

        Without tactels nothing is written, with ``spoilt`` a byte is another one.
        """
        is_one = np.arange(1, tactels + 1) == tactel if tactel else np.ones(tactels, bool)
        limits = np.where(is_one, limit, NO_LIMIT), np.where(is_one, weight, 0), np.full(tactels, rest)
        data = bytearray(GuardLimits(n, m, sum, *limits).encode() if tactels else b"")
        if spoilt >= 0:
            data[spoilt] ^= 1
        self.download("81 20 00", data)

    def program(self, version, product=0x5001, spoilt=-1, n=None):
        """A client sends the image of a program, or its first bytes; of the answers a refusal is left."""
        data = bytearray(make_image(bytes(range(20)), 0x534B4E42, product, version)[:n])
        if spoilt >= 0:
            data[spoilt] ^= 1
        self.download("50 1F 01", data)

    def download(self, place, data):
        steps = [f"600+n 21 {place} {len(data):02X} 00 00 00"]
        for k in range(0, max(len(data), 1), 7):
            part = data[k : k + 7]
            head = (k // 7 % 2) << 4 | (7 - len(part)) << 1 | (k + 7 >= len(data))
            steps.append(f"600+n {head:02X} {part.ljust(7, bytes(1)).hex(' ')}")
        for step in steps:
            self.bench.step([self.bench.frame(step)])
            if self.bench.sent[-1].data[:1] == b"\x80":
                break
        self.bench.sent = [
            f for f in self.bench.sent if f.can_id != self.bench.node_id + 0x580 or f.data[0] == 0x80
        ]

    def old(self):
        self.device.sample_status = SampleStatus.OLD

    def refuse(self):
        self.device.on_write = lambda index, sub, value: AbortCode.LOCAL_CONTROL

    def note_writes(self):
        self.heard.clear()
        self.device.on_write = lambda index, sub, value: self.heard.extend([(index, sub), value])

    def wanted(self, *places_and_values):
        assert list(places_and_values) == self.heard

    def late(self, ms, data=b""):
        """A SYNC that the device comes to only so long after it was on the wire."""
        t_ns = self.bench.now_ns
        self.bench.now_ns += round(NS_PER_MS * ms)
        self.bench.step([Frame(0x080, data, t_ns)])

    def tpdo1(self, kind, inhibit=None, event=None, start=None):
        """TPDO 1 alone, of the given type."""
        for number in (2, 3, 4):
            self.device.set(0x17FF + number, 1, 0xC0000000)
        for sub, value in ((2, kind), (3, inhibit), (5, event), (6, start)):
            if value is not None:
                self.device.set(0x1800, sub, value)
        self.sample(0x1234, -2, 3, 0x7FFF)

    def events(self, kind=254, inhibit=0, event=0, trigger=0x07, upper=0, lower=0, delta=0):
        """TPDO 1 alone, on events; by default by both limits and delta, the same for every input."""
        self.tpdo1(kind, inhibit, event)
        self.sample(0, 0, 0, 0)
        for sub in range(1, 17):
            for index, value in ((0x6421, trigger), (0x6424, upper), (0x6425, lower), (0x6426, delta)):
                self.device.set(index, sub, value)
        self.device.step(0)

    def rpdo(self, *mapping, cob_id=0x211, kind=255, event=0):
        """RPDO 1 maps these values."""
        for sub, value in enumerate((len(mapping), *mapping)):
            self.device.set(0x1600, sub, value)
        for sub, value in ((2, kind), (5, event), (1, cob_id)):
            self.device.set(0x1400, sub, value)


def argument(word):
    """A number, bytes (hex:...), or index and sub-index."""
    index, is_place, sub = word.partition(":")
    if index == "hex":
        return bytes.fromhex(sub)
    return (int(index, 16), int(sub, 16)) if is_place else literal_eval(word)


class Bench:
    """A device on a virtual clock, without heartbeat, and what it has sent."""

    def __init__(
        self,
        which,
        *,
        state="pre",
        node_id=None,
        storage="",
        flags=(),
    ):
        self.which, self.flags = which, flags
        self.is_broken = storage == "broken"
        self.storage = (FLASHES if which == "firmware" else STORAGES)[storage]()
        self.counts = np.zeros(16, np.int32)
        self.is_sampling, self.sampled_ns = True, 0
        self.reader = Reader(lambda: self.counts, 16, bits=16)
        self.node_id = node_id or DEVICES[which][1]
        self.now_ns = 0
        self.power_on()
        self.sent = []
        self.events = []
        if state != "off":
            self.boot()
            if state != "pre":
                self.device.command(To[state])
            self.step()
            self.sent.clear()
            self.events.clear()

    def make(self):
        eds, node_id = DEVICES[self.which]
        if self.which == "firmware":
            writes = {"n_writes": 0} if self.is_broken else {}
            code = code_of(eds, *self.flags)
            return FirmwareDevice(code, self.node_id, serial=SERIAL, flash=self.storage, **writes)
        device = Device(shared_eds(eds, node_id), self.node_id, storage=self.storage)
        device.set(IDENTITY, IDENTITY_SERIAL, SERIAL)
        return device

    def power_on(self):
        self.device = self.make()
        self.host = PatchHost([self.device], self.newest) if self.which == "hosted" else None

    def power(self):
        self.power_on()
        self.boot()

    def sample(self, readings):
        """What the tactels read from now on, the first first."""
        self.counts = np.array([*readings, *self.counts[len(readings) :]], np.int32)
        self.device.image_view(0x6401, 1, 16)[:] = self.counts

    def newest(self, now_ns):
        if self.is_sampling:
            self.reader.call(VirtualClock(now_ns))
        return self.reader.newest(now_ns)

    def boot(self):
        self.step()
        if self.device.nmt_state is not NmtState.INITIALISING:
            self.device.set(HEARTBEAT_PRODUCER, 0, 0)
            if SYNC_PERIOD in self.device.layout.indices:
                self.device.set(SYNC_PERIOD, 0, 0)

    def step(self, frames=()):
        core = self.device
        if self.host:
            core = self.host
            core.wake(0, self.now_ns)  # for what was done to the device by hand
        if self.which == "firmware":
            self.sampled_ns = self.now_ns if self.is_sampling else self.sampled_ns
            self.device.age[0] = (self.now_ns - self.sampled_ns) // AGE_STEP_NS
        out, events, wake_ns = core.step(self.now_ns, frames)
        assert all(len(frame.data) <= 8 and frame.can_id < 0x800 for frame in out)
        self.sent += out
        self.events += events
        return wake_ns

    def pass_time(self, ns):
        """Let time pass, calling the device when it asked to be called."""
        end_ns = self.now_ns + ns
        wake_ns = self.step()
        while wake_ns <= end_ns:
            assert wake_ns >= self.now_ns
            self.now_ns = wake_ns
            wake_ns = self.step()
            assert wake_ns > self.now_ns or wake_ns == NEVER, "the device asks to be called for ever"
        self.now_ns = end_ns
        self.step()

    def frame(self, text):
        can_id, *data = text.split()
        base, _, plus = can_id.partition("+")
        number = int(base, 16) + (self.node_id if plus == "n" else int(plus or "0", 16))
        return Frame(number, bytes(self.node_id if b == "nn" else int(b, 16) for b in data))


def show(frame):
    return f"{frame.can_id:03X} {frame.data.hex(' ').upper()}".strip()


def run(row, which):
    """Run a row and compare every frame."""
    bench = Bench(which, state=row.state, node_id=int(row.node_id), storage=row.storage, flags=row.flags)
    actions = Actions(bench)
    for i, step in enumerate(row.steps):
        where = f"{row.name} on {which}, step {i + 1}"
        text = step.partition(";")[0].strip()
        kind, _, rest = text.partition(" ")
        if kind == "<-":
            assert bench.sent, f"{where}: nothing sent, wanted {rest}"
            got, wanted = show(bench.sent.pop(0)), show(bench.frame(rest))
            assert got == wanted, f"{where}: {step}"
            continue
        assert not bench.sent, f"{where}: unexpected {show(bench.sent[0])} before {step}"
        if kind in ("->", "=>"):
            frame = bench.frame(rest)
            if kind == "=>":
                frame = frame._replace(flags=RTR)
            # what the device does not listen to never reaches it on the wire; it must not matter if it does
            bench.step([frame])
            if not receives(bench.device.cob_ids, frame):
                assert not bench.sent, f"{where}: answered a frame it does not listen to"
        elif kind == "--":
            assert bench.frame(rest).can_id not in bench.device.cob_ids, where
        elif kind == "power":
            bench.power()
        elif kind == "++":
            bench.pass_time(int(float(rest) * NS_PER_MS))
        else:
            actions.act(text.split())
            if kind != "late":
                bench.step()
    assert not bench.sent, f"{row.name} on {which}: unexpected {show(bench.sent[0])} at the end"
    assert bench.device.nmt_state in NmtState
