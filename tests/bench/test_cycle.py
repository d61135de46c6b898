"""One full cycle of a forearm, 24 patches and 5 contacts: gather, estimate, publish.

python -m pytest tests/bench/test_cycle.py --benchmark-enable
"""

import numpy as np
import pytest

from skinbus.can.frame import FrameBatch
from skinbus.config.system import load_arm
from skinbus.master import Master
from skinbus.model import Cone
from skinbus.objects import cia

pytestmark = pytest.mark.slow

TOUCHES = [(0.025, 0.0), (0.0255, 0.1275), (0.051, -0.1), (0.077, 0.0765), (0.128, -0.05)]
"""(s, a) in m: two of them on seams, the rest inside patches."""

PERIOD_NS = 20_000_000


@pytest.fixture(scope="module")
def master():
    """A master whose patches are all operational."""
    master = Master(load_arm("forearm"))
    master.step(0, [])
    master.table.state[:] = 4
    return master


@pytest.fixture(scope="module")
def frames(master):
    """The data frames of one cycle with five contacts."""
    arm = master.arm
    law, surface = Cone(2e6), arm.links[0].surface
    pressures = sum(
        law.pressure(surface.distance(arm.tactel_s, arm.tactel_a, s, a), 12.0) for s, a in TOUCHES
    )
    plan = master.gather.plan
    rng, batches = np.random.default_rng(1), []
    for n in range(32):  # the first half without a touch; readings that never change would be frozen
        noisy = (pressures if n >= 16 else 0.0) + 200.0 * rng.standard_normal(arm.n_tactels)
        batch = FrameBatch(plan.n_frames)
        plan.pack(np.rint(noisy / plan.counts_scale).astype(np.int32), batch)
        batches.append(batch)
    return batches


def test_forearm_cycle_gather_estimate_publish(benchmark, master, frames):
    now = [0]

    def next_sync():
        now[0] += PERIOD_NS
        master.table.last_heard[:] = now[0]  # their heartbeats come between the cycles
        sent = master.step(now[0], []).frames
        assert any(f.can_id == cia.SYNC_ID for f in sent)

    def cycle():
        master.take(now[0] + 12_000_000, frames[16 + now[0] // PERIOD_NS % 16])
        return master.step(now[0] + 12_000_000, [])

    for n in range(120):  # zeros are found before the touch
        next_sync()
        master.take(now[0] + 12_000_000, frames[n % 16 + (16 if n >= 100 else 0)])
        master.step(now[0] + 12_000_000, [])
    step = benchmark.pedantic(cycle, setup=next_sync, rounds=300, warmup_rounds=20)
    contacts = [f for f in step.frames if 0x681 <= f.can_id <= 0x690]
    assert len(contacts) == 5
