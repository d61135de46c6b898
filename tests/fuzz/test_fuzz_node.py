"""Random frames into the device cores: no exception, no wrong state, no reading changed, memory flat.

Identifiers are biased to those the device listens to, bytes to those that mean something to it.
"""

import random

import pytest

from skinbus.can.frame import Frame
from skinbus.node import Device
from skinbus.node.lss import LSS_MASTER_ID
from skinbus.node.nmt import TRANSITIONS
from skinbus.objects.cia import NmtCommand, NmtState
from skinbus.objects.eds import load_eds
from tests.fuzz.feeding import feed
from tests.run_in_process import run_in_process

SEED = 20260101
DEVICES = {"patch": ("skin-patch", 5, 0x6401, 16), "master": ("skin-master", 127, 0x3001, 5)}
"""EDS, node-ID, and the readings or contacts that no frame may change."""
SHORT_NS = 100_000
LONG_NS = 300_000_000
"""Time between two frames; now and then long enough for every timer to run out."""
MAX_GROWTH = 400_000
"""Bytes that a device may come to hold while it is fed: domains and queues have bounds."""

# A state follows another only like this: by a command, by the end of a boot, or by an error (0x1029).
FOLLOWS = {(before, after) for before in NmtState for after in TRANSITIONS.values()}
FOLLOWS |= {(NmtState.INITIALISING, NmtState.PRE_OPERATIONAL)}

NUMBERS = (0, 0, 1, 1, 2, 5, 50, 240, 254, 255, 500, 0x211, 0x65766173, 0x64616F6C, 0xC0000000, 0x64010310)
"""What a tool would write, beside what is delivered: "save" and "load", a PDO that is off, a mapping."""
SIZES = [bytes((n, m, 0, 0)) for n, m in ((127, 0), (2, 4), (1, 0))]
"""Segments of a block, and the threshold below which none is wanted."""
BLOCK_COMMANDS = [*[b"\xa3"] * 8, *(bytes((0xA2, n, 2)) for n in (0, 1, 2) for _ in range(4))]
BLOCK_COMMANDS += [bytes((c,)) for c in (0xA1, 0xC1, 0xC5, 0x80)] + [
    bytes((n,)) * 8 for n in (1, 2, 0x81, 0x82, 127)
]
"""What goes on with a block: as often as there is something to go on with."""
LSS_COMMANDS = bytes.fromhex("040411111315174043464b4c51515a5e")


class Feeder:
    """Makes frames that come close to what the device expects."""

    def __init__(self, device):
        self.device = device
        self.rng = random.Random(SEED)
        # index and sub-index of every entry, as an SDO carries them
        self.places = [bytes((key >> 8 & 0xFF, key >> 16, key & 0xFF)) for key in device.layout.entries]
        entries = zip(self.places, device.layout.entries.values(), strict=True)
        self.writable = [
            (place, entry.size, int.from_bytes(entry.default, "little") + entry.relative * device.node_id)
            for place, entry in entries
            if entry.writable and entry.index not in range(0x2000, 0x6000) and 0 < entry.size <= 4
        ]
        identity = [device.get(0x1018, sub).to_bytes(4, "little") for sub in (1, 2, 3, 4)]
        self.lss = [bytes((command + i,)) + identity[i] for i in range(4) for command in (0x40, 0x5A)]
        self.lss += [bytes((0x51,)) + identity[i] + bytes((0, i, (i + 1) % 4)) for i in range(4)]
        self.lss += [bytes.fromhex(text) for text in ("5100000000800000", "4c", "17", "0400", "0400", "0401")]
        self.lss += [bytes((0x11, n)) for n in (5, 6, 255)]

    def frame(self):
        """One frame for an identifier the device listens to now; every eighth is for any identifier."""
        rng, choose = self.rng, self.rng.choice
        sdo, kind, payload = 0x600 + self.device.node_id, rng.randrange(64), rng.randbytes(8)
        ids = [*self.device.cob_ids, 0x000, 0x080, sdo, sdo, LSS_MASTER_ID, 0x211, 0x709]
        can_id = rng.randrange(0x800) if kind < 8 else choose(ids)
        if kind < 12:
            payload = payload[: rng.randrange(9)]
        elif can_id == 0:
            # resets are rare, or nothing would ever come of a configuration
            payload = bytes((choose((1, 1, 1, 2, 128, 129, 130) if kind > 60 else (1, 1, 128)), 0))
        elif can_id == sdo and kind < 40:
            place, size, delivered = choose(self.writable)
            number = choose((delivered, *NUMBERS)) % (1 << 8 * size)
            payload = bytes((0x23 | (4 - size) << 2,)) + place + number.to_bytes(4, "little")
        elif can_id == sdo and kind < 44:
            command = choose((0xA0, 0xA4, 0xC0, 0xC4))
            payload = (
                bytes((command,)) + choose(self.places) + (choose(SIZES) if command < 0xC0 else bytes(4))
            )
        elif can_id == sdo and kind < 48:
            payload = choose(BLOCK_COMMANDS).ljust(8, b"\0")
        elif can_id == sdo:
            payload = bytes((payload[0] & 0x7F,)) + choose(self.places) + payload[4:]
        elif can_id == LSS_MASTER_ID:
            payload = choose(self.lss) if kind < 56 else bytes((choose(LSS_COMMANDS),)) + payload[1:]
            payload = payload.ljust(8, b"\0")
        elif can_id == 0x080:
            payload = payload[:1]
        elif can_id >= 0x700:
            payload = bytes((choose((0, 4, 5, 127)),))
        return Frame(can_id, payload, 0, choose((1, 2, 4, 8)) if kind == 12 else 0)


def fuzz(which, n_frames):
    """Feed one device; return how many frames it sent and dropped, and how often it was reset."""
    eds, node_id, index, n_subs = DEVICES[which]
    device = Device(load_eds(eds, node_id), node_id, storage={})
    readings = device.image_view(index, 1, n_subs)
    before, feeder = readings.tobytes(), Feeder(device)
    last, n_resets = device.nmt_state, 0

    def enter(state):
        nonlocal last, n_resets
        assert (last, state) in FOLLOWS, f"{last.name} -> {state.name}"
        n_resets += state is NmtState.INITIALISING
        last = state

    def frames(n):
        for frame in (feeder.frame() for _ in range(n)):
            yield LONG_NS if frame.can_id & 0xFF == 0x42 else SHORT_NS, frame

    def after_chunk():
        assert device.nmt_state in NmtState
        assert readings.tobytes() == before, "a reading has changed"
        assert device.get(0x1003, 0) <= 8
        device.transmit_tpdo(1)
        device.emcy(0x5000, data=bytes(1))
        device.emcy_clear(0x5000)

    device.on_nmt = enter
    sent, now_ns = feed(device, n_frames, frames, after_chunk, least_id=1, max_growth=MAX_GROWTH)
    # after all that, a reset and a read are answered as on the first day
    for data in (bytes((4, 1)), bytes((0x11, 5)), bytes((4, 0))):  # a node-ID, in case it has lost its own
        device.step(now_ns, [Frame(0, bytes((128, 0))), Frame(LSS_MASTER_ID, data.ljust(8, b"\0"))])
    device.command(NmtCommand.RESET_NODE)
    device.step(now_ns)
    request = Frame(0x600 + device.node_id, bytes.fromhex("4001100000000000"))
    answer = device.step(now_ns, (request,)).frames[-1]
    assert (answer.can_id, answer.data[:4]) == (0x580 + device.node_id, bytes.fromhex("4F011000"))
    return sent, device.dropped, n_resets


@pytest.mark.parametrize("n_frames", [5_000, pytest.param(50_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("which", DEVICES)
def test_random_frames_break_nothing(which, n_frames):
    print(f"seed {SEED}")
    n_sent, n_dropped, n_resets = run_in_process(fuzz, which, n_frames)
    assert n_sent > n_frames // 50
    assert n_dropped > n_frames // 500
    assert n_resets > n_frames // 5000
