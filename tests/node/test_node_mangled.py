"""The frames of the conformance table once more: twice each, backwards, cut short, one byte changed."""

import random

import pytest

from skinbus.can.frame import Frame
from skinbus.node.lss import UNCONFIGURED
from skinbus.objects.cia import NmtState
from tests.node.conformance_rows import ROWS
from tests.node.node_table import Bench, Row

SEED = 7


def twice(frames, rng):
    return [frame for frame in frames for _ in range(2)]


def backwards(frames, rng):
    return frames[::-1]


def cut_short(frames, rng):
    return [Frame(f.can_id, f.data[:n]) for f in frames for n in range(len(f.data))]


def one_byte_changed(frames, rng):
    changed = []
    for frame in frames:
        data = bytearray(frame.data)
        if data:
            data[rng.randrange(len(data))] = rng.randrange(256)
        changed.append(Frame(frame.can_id, bytes(data)))
    return changed


def shuffled(frames, rng):
    return rng.sample(frames, len(frames))


def frames_of(row: Row, bench: Bench):
    texts = [step.partition(";")[0][3:] for step in row.steps if isinstance(step, str) and step[:2] == "->"]
    return [bench.frame(text) for text in texts]


@pytest.mark.parametrize("mangle", [twice, backwards, cut_short, one_byte_changed, shuffled])
@pytest.mark.parametrize("which", ["patch", "master"])
def test_device_survives_and_answers_as_before(which, mangle):
    print(f"seed {SEED}")
    rng = random.Random(SEED)
    bench = Bench(which)
    for row in ROWS:
        bench.node_id = bench.device.node_id
        for frame in mangle(frames_of(row, bench), rng):
            bench.now_ns += 100_000
            bench.step([frame])
            assert bench.device.nmt_state in NmtState
        bench.step([Frame(0, bytes((0x81, 0)))])
        if bench.device.node_id == UNCONFIGURED:  # LSS has taken its node-ID: it answers no SDO
            bench = Bench(which)
        bench.sent.clear()
        bench.step([Frame(0x600 + bench.device.node_id, bytes.fromhex("4001100000000000"))])
        assert bench.sent[-1].data[:4] == bytes.fromhex("4F011000"), row.name
