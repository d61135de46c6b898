"""What the in-process bus costs, and the exact length of a frame."""

import numpy as np
import pytest

from skinbus.can.core import NEVER, Core, Step
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.can.wire_bits import classic_bits

pytestmark = pytest.mark.slow

SEED = 20250101
MS_NS = 1_000_000


class Patches(Core):
    """Answers each SYNC with four frames of eight random bytes per patch, like a world of patches would."""

    cob_ids = frozenset({0x80})

    def __init__(self, n_patches: int) -> None:
        rng = np.random.default_rng(SEED)
        self.frames = [
            Frame(0x80 + 0x100 * k + node_id, rng.bytes(8))
            for node_id in range(1, n_patches + 1)
            for k in range(1, 5)
        ]

    def step(self, now_ns, frames):
        return Step(self.frames if frames else (), (), NEVER)


class Sync(Core):
    """Sends SYNC at a steady rate and hears everything."""

    cob_ids = None

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.next_ns = 0
        self.n_heard = 0

    def step(self, now_ns, frames):
        self.n_heard += len(frames)
        if now_ns < self.next_ns:
            return Step((), (), self.next_ns)
        self.next_ns += self.period_ns
        return Step((Frame(0x80),), (), self.next_ns)


def run_bus(n_patches: int, period_ms: int, seconds: int) -> int:
    """How many frames cross a bus of so many patches in so many seconds."""
    wire = VirtualBus()
    sync = Sync(period_ms * MS_NS)
    wire.attach(sync)
    wire.attach(Patches(n_patches))
    wire.run(seconds * 1000 * MS_NS)
    return wire.n_frames


def test_one_second_of_24_patches_at_50_hz(benchmark):
    n = benchmark(run_bus, 24, 20, 1)
    benchmark.extra_info["frames"] = n
    assert n == 50 * 97


def test_one_second_of_126_patches_at_14_hz(benchmark):
    n = benchmark(run_bus, 126, 70, 1)
    benchmark.extra_info["frames"] = n
    assert n > 14 * 505


def test_length_of_one_frame(benchmark):
    assert 111 <= benchmark(classic_bits, Frame(0x181, b"\x12\x34\x56\x78\x9a\xbc\xde\xf0")) <= 135
