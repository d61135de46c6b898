"""Random frames into the device cores: no exception, no wrong state, no reading changed, memory flat.

``python -m tests.fuzz.fuzz_node`` runs ten million frames; ``--frames`` and ``--seed`` choose otherwise.
Identifiers are biased to those the device listens to, bytes to those that mean something to it.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from skinbus.can.frame import Frame
from skinbus.node import Device
from skinbus.node.lss import LSS_MASTER_ID
from skinbus.node.nmt import TRANSITIONS
from skinbus.node.storage import MemoryStorage
from skinbus.objects.cia import NmtCommand, NmtState
from skinbus.objects.eds import load_eds
from tests.fuzz.feeding import CHUNK, asked_for, feed

DEVICES = {"patch": ("skin-patch", 5), "master": ("skin-master", 127)}
SHORT_NS = 100_000
LONG_NS = 300_000_000
"""Time between two frames; now and then long enough for every timer to run out."""
MAX_GROWTH = 400_000
"""Bytes that a device may come to hold while it is fed: domains and queues have bounds."""

# A state follows another only like this: by a command, by the end of a boot, or by an error (0x1029).
FOLLOWS = {(before, after) for before in NmtState for after in TRANSITIONS.values()}
FOLLOWS |= {(NmtState.INITIALISING, NmtState.PRE_OPERATIONAL)}


@dataclass(frozen=True)
class Report:
    """What a run has seen."""

    n_sent: int
    n_dropped: int
    n_resets: int


def places(device: Device) -> list[bytes]:
    """Index and sub-index of every entry, as an SDO carries them."""
    return [bytes((key >> 8 & 0xFF, key >> 16, key & 0xFF)) for key in device.layout.entries]


# What a tool would write, as (index, sub-indices, size, values); random bytes would hardly ever say it.
SENSIBLE: Final = (
    (0x1010, (1, 2, 3, 4), 4, (0x65766173,)),  # "save"
    (0x1011, (1, 2, 3, 4), 4, (0x64616F6C,)),  # "load"
    (0x1016, (1, 2), 4, (50, 0x90032, 0xA0032)),
    (0x1029, (1,), 1, (0, 1, 2)),
    (0x1017, (0,), 2, (0, 1, 500)),
    (0x1015, (0,), 2, (0, 0, 50)),
    (0x1019, (0,), 1, (0, 2, 240)),
    (0x1006, (0,), 4, (0, 5000)),
    (0x1005, (0,), 4, (0x80, 0x40000080)),
    (0x1400, (1,), 4, (0x211, 0x212, 0x80000211)),
    (0x1400, (2,), 1, (0, 1, 255)),
    (0x1400, (5,), 2, (0, 10)),
    (0x1600, (0,), 1, (0, 1, 2, 3)),
    (0x1600, (1, 2, 3), 4, (0x20500020, 0x00050008, 0x00010001)),
    (0x1800, (1,), 4, (0xC0000000, 0x40000185)),
    (0x1801, (1,), 4, (0xC0000000, 0x40000285)),
    *((0x1800 + n, (2,), 1, (0, 1, 2, 254, 255)) for n in (0, 1, 2)),
    *((0x1800 + n, (3,), 2, (0, 100)) for n in (0, 1)),
    *((0x1800 + n, (5,), 2, (0, 20)) for n in (0, 1)),
    *((0x1800 + n, (6,), 1, (0, 3)) for n in (0, 1)),
    (0x1A00, (0,), 1, (0, 1, 2, 4)),
    (0x1A00, (1, 2), 4, (0x64010110, 0x64010310, 0x10010008)),
    (0x6423, (0,), 1, (0, 1)),
    (0x6421, (1, 2, 3), 1, (0, 5, 10, 15, 20, 25, 30)),
    (0x6426, (1, 2, 3), 4, (0, 100)),
)
SENSIBLE_WRITES: Final = [  # expedited downloads
    bytes((0x23 | (4 - size) << 2, index & 0xFF, index >> 8, sub)) + value.to_bytes(4, "little")
    for index, subs, size, values in SENSIBLE
    for sub in subs
    for value in values
]
SIZES = (bytes((127, 0, 0, 0)), bytes((2, 4, 0, 0)), bytes((1, 0, 0, 0)))
"""Segments of a block, and the threshold below which none is wanted."""
LSS_COMMANDS = bytes.fromhex("040411111315174043464b4c51515a5e")


class Feeder:
    """Makes frames that come close to what the device expects."""

    def __init__(self, device: Device, seed: int) -> None:
        self.device = device
        self.rng = np.random.default_rng(seed)
        self.choose = random.Random(seed)
        self.places = places(device)
        identity = [device.get(0x1018, sub).to_bytes(4, "little") for sub in (1, 2, 3, 4)]
        self.lss = [bytes((command + i,)) + identity[i] for i in range(4) for command in (0x40, 0x5A)]
        self.lss += [bytes((0x51,)) + identity[i] + bytes((0, i, (i + 1) % 4)) for i in range(4)]
        self.lss += [bytes((0x51, 0, 0, 0, 0, 0x80, 0, 0)), bytes((0x4C,)), bytes((0x17,))]
        self.lss += [bytes((0x04, mode)) for mode in (0, 0, 1)] + [bytes((0x11, n)) for n in (5, 6, 255)]

        self.blocks = [bytes((c,)) + p + size for c in (0xA0, 0xA4) for p in self.places for size in SIZES]
        self.blocks += [bytes((c,)) + p + bytes(4) for c in (0xC0, 0xC4) for p in self.places]
        n_asked = len(self.blocks)
        self.blocks += [
            bytes((0xA3,)).ljust(8, b"\0")
        ] * n_asked  # as often as there is something to go on with
        self.blocks += [bytes((0xA2, n, 2)).ljust(8, b"\0") for n in (0, 1, 2) for _ in range(n_asked // 2)]
        self.blocks += [
            bytes((c,)).ljust(8, b"\0") for c in (0xA1, 0xC1, 0xC5, 0x80) for _ in range(n_asked // 8)
        ]
        self.blocks += [bytes((n,)) * 8 for n in (1, 2, 0x81, 0x82, 127) for _ in range(n_asked // 8)]

    def chunk(self) -> list[Frame]:
        """Frames for the identifiers the device listens to now; every eighth is for any identifier."""
        choose = self.choose.choice
        node_id = self.device.node_id
        sdo = 0x600 + node_id
        ids = [*self.device.cob_ids, 0x000, 0x080, sdo, sdo, LSS_MASTER_ID, 0x211, 0x709]
        random_ids = self.rng.integers(0, 0x800, CHUNK).tolist()
        kinds = self.rng.integers(0, 64, CHUNK).tolist()
        lengths = self.rng.integers(0, 9, CHUNK).tolist()
        data = self.rng.bytes(8 * CHUNK)
        frames = []
        for i in range(CHUNK):
            kind = kinds[i]
            can_id = random_ids[i] if kind < 8 else choose(ids)
            payload = data[8 * i : 8 * i + 8]
            if kind < 12:
                payload = payload[: lengths[i]]
            elif can_id == 0:
                # resets are rare, or nothing would ever come of a configuration
                command = choose((1, 1, 1, 2, 128, 129, 130)) if kind > 60 else choose((1, 1, 128))
                payload = bytes((command, 0))
            elif can_id == sdo:
                if kind < 40:
                    payload = choose(SENSIBLE_WRITES)
                elif kind < 48:
                    payload = choose(self.blocks)
                else:
                    payload = bytes((payload[0] & 0x7F,)) + choose(self.places) + payload[4:]
            elif can_id == LSS_MASTER_ID:
                payload = choose(self.lss) if kind < 56 else bytes((choose(LSS_COMMANDS),)) + payload[1:]
                payload = payload.ljust(8, b"\0")
            elif can_id == 0x080:
                payload = payload[:1]
            elif can_id >= 0x700:
                payload = bytes((choose((0, 4, 5, 127)),))
            frames.append(Frame(can_id, payload, 0, choose((1, 2, 4, 8)) if kind == 12 else 0))
        return frames


def fuzz(which: str, n_frames: int, seed: int) -> Report:
    """Feed one device; AssertionError says what broke, after how many frames."""
    eds, node_id = DEVICES[which]
    device = Device(load_eds(eds, node_id), node_id, storage=MemoryStorage())
    readings = device.image_view(0x6401, 1, 16) if which == "patch" else device.image_view(0x3001, 1, 5)
    before_readings = readings.tobytes()
    states = [device.nmt_state]
    resets = 0

    def enter(state: NmtState) -> None:
        nonlocal resets
        resets += state is NmtState.INITIALISING
        assert (states[-1], state) in FOLLOWS, f"{states[-1].name} -> {state.name}"
        states[0] = states[-1] = state

    device.on_nmt = enter
    feeder = Feeder(device, seed)
    n_chunks = 0

    def frames(n: int) -> Iterator[tuple[int, Frame]]:
        for frame in feeder.chunk()[:n]:
            yield LONG_NS if frame.can_id & 0xFF == 0x42 else SHORT_NS, frame

    def after_chunk() -> None:
        nonlocal n_chunks
        n_chunks += 1
        assert device.nmt_state in NmtState
        assert readings.tobytes() == before_readings, "a reading has changed"
        assert device.get(0x1003, 0) <= 8
        device.transmit_tpdo(1)
        device.emcy(0x5000, data=bytes((n_chunks & 3,)))
        device.emcy_clear(0x5000)

    print(which, "seed", seed)
    sent, now_ns = feed(device, n_frames, frames, after_chunk, least_id=1, max_growth=MAX_GROWTH)
    _still_works(device, now_ns)
    return Report(sent, device.dropped, resets)


def _still_works(device: Device, now_ns: int) -> None:
    """After all that, a reset and a read are answered as on the first day."""
    for data in (bytes((4, 1)), bytes((0x11, 5)), bytes((4, 0))):  # a node-ID, in case it has lost its own
        device.step(now_ns, [Frame(0, bytes((128, 0))), Frame(LSS_MASTER_ID, data.ljust(8, b"\0"))])
    device.command(NmtCommand.RESET_NODE)
    device.step(now_ns)
    request = Frame(0x600 + device.node_id, bytes.fromhex("4001100000000000"))
    out = device.step(now_ns, (request,)).frames
    assert [frame.can_id for frame in out][-1:] == [0x580 + device.node_id]
    assert out[-1].data[:4] == bytes.fromhex("4F011000")


if __name__ == "__main__":
    n_frames, seed = asked_for(__doc__)
    for which in DEVICES:
        print(fuzz(which, n_frames // 2, seed), flush=True)
