"""One full cycle of a forearm, 24 patches and 5 contacts: gather, judge, estimate, publish.

python -m pytest tests/bench/test_cycle.py --benchmark-enable
"""

import numpy as np
import pytest

from skinbus.can.frame import FrameBatch
from skinbus.can.virtual_bus import VirtualBus
from skinbus.master import Master
from skinbus.model import Cone
from skinbus.objects import cia
from skinbus.sim import World, load_scene
from tests.packing import pack

pytestmark = pytest.mark.slow

TOUCHES = [(0.025, 0.0), (0.0255, 0.1275), (0.051, -0.1), (0.077, 0.0765), (0.128, -0.05)]
"""(s, a) in m: two of them on seams, the rest inside patches."""

PERIOD_NS = 20_000_000
QUIET, PRESSED = range(16), range(16, 32)
"""Cycles of readings: those that never change would be frozen."""


@pytest.fixture(scope="module")
def master():
    """A master that has booted all its patches."""
    scene = load_scene("forearm")
    master, wire = Master(scene.arm), VirtualBus(scene.arm.bus.bitrate)
    wire.attach(World(scene))
    wire.attach(master)
    wire.run(1_500_000_000)
    assert master.table.is_running.all()
    return master


@pytest.fixture(scope="module")
def frames(master):
    """The data frames of cycles without a touch and with five."""
    arm = master.arm
    law, surface = Cone(2e6), arm.links[0].surface
    pressures = sum(
        law.pressure(surface.distance(arm.tactel_s, arm.tactel_a, s, a), 12.0) for s, a in TOUCHES
    )
    plan = master.gather.plan
    rng, batches = np.random.default_rng(1), []
    for n in [*QUIET, *PRESSED]:
        noisy = (pressures if n in PRESSED else 0.0) + 200.0 * rng.standard_normal(arm.n_tactels)
        batch = FrameBatch(plan.n_frames)
        pack(plan, np.rint(noisy / plan.counts_scale).astype(np.int32), batch)
        batches.append(batch)
    return batches


def test_forearm_cycle_gather_estimate_publish(benchmark, master, frames):
    cycles = {"n": 0, "now_ns": 1_500_000_000}

    def next_readings(which=PRESSED):
        """Step to the next SYNC; return the readings that answer it, at the arguments of ``cycle``."""
        while True:
            cycles["now_ns"] += 1_000_000
            sent = master.step(cycles["now_ns"], []).frames
            if any(frame.can_id == cia.SYNC_ID for frame in sent):
                break
        master.table.last_heard[:] = cycles["now_ns"]  # their heartbeats come between the cycles
        cycles["n"] += 1
        batch = frames[which[cycles["n"] % len(which)]]
        batch.t_ns[: batch.n] = cycles["now_ns"] + 6_000_000  # an older frame would be of no cycle
        return (batch,), {}

    def cycle(batch):
        now_ns = cycles["now_ns"] = cycles["now_ns"] + 12_000_000
        master.take(now_ns, batch)
        return master.step(now_ns, [])

    for n in range(120):
        cycle(*next_readings(QUIET if n < 100 else PRESSED)[0])  # zeros are found before the touches
    step = benchmark.pedantic(cycle, setup=next_readings, rounds=300, warmup_rounds=20)
    contacts = [f for f in step.frames if 0x681 <= f.can_id <= 0x690]
    assert len(contacts) == 5
