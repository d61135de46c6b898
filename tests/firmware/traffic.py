"""Random traffic for one device: mostly what a master sends, often a little wrong."""

import random
import struct
from pathlib import Path

import numpy as np

from skinbus.can.fd import CLASSIC_BYTES, LENGTHS
from skinbus.can.frame import RTR, Frame
from skinbus.node.layout import key_of
from skinbus.objects.cia import READINGS
from skinbus.objects.guard import NO_LIMIT, GuardLimits
from tests.firmware.images import make_image

WATCHED = 9
STAMP = 0x2070
STEPS_US = (0, 0, 0, 1, 50, 1_000, 5_000, 20_000, 100_000, 700_000, 1_200_000)
COMMANDS = (1, 1, 1, 2, 128, 128, 129, 130, 3)
BLOCKS = ("A1", "A3", "A3", "A20002", "A20102", "A20202", "C1", "C5", "80", "01" * 8, "02" * 8, "82" * 8)
"""How a block transfer goes on: commands, and segments by their numbers."""
SIGNATURES = (b"save", b"load", b"evas")
WEIGHTS = {"limits": 2, "sync": 6, "read": 3, "write": 8, "configure": 3, "segment": 2, "nmt": 2}
WEIGHTS |= dict.fromkeys(("lss", "heartbeat", "guarding", "rpdo", "store", "junk"), 1)
"""How often each kind comes."""


class Traffic:
    """Frames for a board of a layout, from a seed; each ``next`` gives (us that pass, frame or None)."""

    def __init__(self, layout, node_id, seed):
        self.rng = random.Random(seed)
        self.node_id = node_id
        # the simulated patch leaves the stamp of the last SYNC on samples for events, the firmware does not
        self.has_events = layout.max_pdo_bits == 8 * CLASSIC_BYTES
        lines = (Path(__file__).parent / "traffic.txt").read_text().splitlines()
        self.table = [line.partition(";")[0] for line in lines if self.has_events or ";" not in line]
        entries = layout.entries.values()
        self.entries = [e for e in entries if not (self.has_events and e.index == STAMP)]
        self.parameters = [e for e in self.entries if 0x1000 < e.index < 0x1F00 and e.writable]
        self.board = [layout.entries[key_of(0x1018, sub)].variable.default for sub in (1, 2)]
        self.n_tactels = sum(len(layout.subs(i)) for i in READINGS if i in layout.indices)
        self.left = []
        # a stamp of before the restart is left in the simulated patch
        weights = WEIGHTS | {"program": self.has_events}
        self.kinds = tuple(getattr(self, kind) for kind, n in weights.items() for _ in range(n))

    def __iter__(self):
        while True:
            goes_on = self.left and self.rng.random() < 0.99
            yield self.rng.choice(STEPS_US), self.left.pop(0) if goes_on else self.rng.choice(self.kinds)()

    def sdo(self, command, index, sub, data=b""):
        head = struct.pack("<BHB", command, index, sub)
        return Frame(0x600 + self.node_id, head + data.ljust(4, b"\0")[:4])

    def number(self, size):
        rng = self.rng
        value = rng.choice((0, 0, 1, 2, 3, 5, 10, 100, 240, 254, 255, 0x7FFF, rng.getrandbits(8 * size)))
        return value.to_bytes(8, "little")[:size]

    def sync(self):
        return Frame(0x80, bytes([self.rng.randrange(1, 6)])[: self.rng.choice((0, 0, 0, 1))])

    def read(self):
        entry = self.rng.choice(self.entries)
        return self.sdo(0x40, entry.index, entry.sub)

    def write(self):
        entry = self.rng.choice(self.parameters if self.rng.random() < 0.7 else self.entries)
        size = min(entry.size, 4) if self.rng.random() < 0.95 else self.rng.randrange(1, 5)
        is_event = entry.index == 0x6423 or (0x1800 <= entry.index < 0x1A00 and entry.sub == 2)
        if not entry.size or entry.index in (0x1010, 0x1011) or (is_event and not self.has_events):
            return self.read()
        return self.sdo(0x23 | (4 - size) << 2, entry.index, entry.sub, self.number(size))

    def configure(self):
        """A write of what matters most, with a value that makes sense."""
        place, size, *values = self.rng.choice(self.table).split()
        index, sub = (int(word, 16) for word in place.split(":"))
        value = self.rng.choice(values)
        number = int(value.rstrip("n"), 16) + self.node_id * value.endswith("n")
        return self.sdo(0x23 | (4 - int(size)) << 2, index, sub, number.to_bytes(4, "little"))

    def store(self):
        index, sub = self.rng.choice((0x1010, 0x1011)), self.rng.randrange(1, 6)
        return self.sdo(0x23, index, sub, self.rng.choice(SIGNATURES))

    def limits(self):
        """Limits of the guard, now and then spoilt or none; the segments follow."""
        rng, n = self.rng, self.n_tactels
        limits, weights = rng.choices((20, 60, 100, NO_LIMIT), k=n), rng.choices((0, 0, 1, 3), k=n)
        m = rng.choice((1, 1, 1, 2, 4, 8, 9))
        rest = np.array(rng.choices((0, -20, 9), k=n))
        total = rng.choice((300, 2**31 - 1))
        made = GuardLimits(rng.randint(1, m), m, total, np.array(limits), np.array(weights), rest).encode()
        data = bytearray(made[: rng.choice((len(made),) * 9 + (0, 3))])
        if data and not rng.randrange(9):
            data[rng.randrange(len(data))] ^= 1
        first, *self.left = self.download(0x2081, 0, data)
        return first

    def download(self, index, sub, data):
        """The frames that write data in segments."""
        parts = [data[k : k + 7] for k in range(0, max(len(data), 1), 7)]
        heads = [k % 2 << 4 | (7 - len(part)) << 1 | (k + 1 == len(parts)) for k, part in enumerate(parts)]
        segments = [bytes([head]) + part.ljust(7, b"\0") for head, part in zip(heads, parts, strict=True)]
        first = self.sdo(0x21, index, sub, len(data).to_bytes(4, "little"))
        return [first, *(Frame(0x600 + self.node_id, segment) for segment in segments)]

    def program(self):
        """A new program, for a board in any state; what follows confirms it, or not."""
        rng = self.rng
        self.image = make_image(rng.randbytes(rng.randrange(9)), *self.board, rng.randrange(2**32))
        ends = Frame(0, bytes([1, self.node_id])), self.control(0x80), Frame(0, bytes([129, self.node_id]))
        image = self.download(0x1F50, 1, self.image)
        self.left = [self.control(3), *image, self.control(1), *rng.sample(ends, 2)]
        return Frame(0, bytes([128, self.node_id]))

    def control(self, command):
        return self.sdo(0x2F, 0x1F51, 1, bytes([command]))

    def segment(self):
        rng = self.rng
        begin = (self.sdo(0x40, 0x1008, 0), self.sdo(0x21, 0x2040, 0, b"\x08"), self.sdo(0x20, 0x1015, 0))
        command = rng.choice((0x60, 0x70, 0x00, 0x10, 0x1D, 0x0D, 0x0B, 0x80))
        return rng.choice((*begin, *[Frame(0x600 + self.node_id, bytes([command]) + rng.randbytes(7))] * 4))

    def block(self):
        """A block transfer begins; what may go on with it follows. Of no kind: the firmware has none."""
        rng = self.rng
        words = (bytes.fromhex(rng.choice(BLOCKS)) for _ in range(rng.randrange(6)))
        self.left = [Frame(0x600 + self.node_id, word.ljust(8, b"\0")) for word in words]
        entry, command = rng.choice(self.entries), rng.choice((0xA0, 0xA4, 0xC0, 0xC4))
        return self.sdo(command, entry.index, entry.sub, rng.choice((b"\x01", b"\x02\x04", b"\x7f")))

    def nmt(self):
        rng = self.rng
        to = rng.choice((0, self.node_id, self.node_id, self.node_id + 1))
        return Frame(0, bytes([rng.choice(COMMANDS), to, 0])[: rng.choice((2, 2, 2, 2, 1, 3))])

    def lss(self):
        rng = self.rng
        command = rng.choice((0x04, 0x04, 0x11, 0x13, 0x17, 0x40, 0x41, 0x46, 0x4B, 0x4C, 0x51, 0x5A, 0x5E))
        value = rng.choice((bytes([rng.randrange(3)]), bytes([self.node_id]), rng.randbytes(7)))
        return Frame(0x7E5, (bytes([command]) + value).ljust(8, b"\0")[: rng.choice((8, 8, 8, 8, 7))])

    def heartbeat(self):
        rng = self.rng
        state = rng.choice((0, 4, 5, 5, 127, 133, 34))
        return Frame(0x700 + WATCHED, bytes([state, 0])[: rng.choice((1, 1, 1, 2))])

    def guarding(self):
        return Frame(0x700 + self.node_id, b"\0", 0, RTR)

    def rpdo(self):
        return Frame(0x200 + self.node_id, self.rng.randbytes(self.rng.choice((0, 3, 4, 4, 4, 8))))

    def junk(self):
        rng = self.rng
        ids = (rng.randrange(0x800), 0x600 + self.node_id, 0x80, 0x7E5)
        return Frame(rng.choice(ids), rng.randbytes(rng.choice(LENGTHS[:9])))
