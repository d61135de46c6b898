"""Long uptimes: counters wrap, clocks grow, and nothing that is published notices."""

import pytest

from skinbus.can.core import NEVER, Core
from skinbus.can.virtual_bus import VirtualBus
from tests.master.rig import MS, Rig

CYCLE_NS = 20 * MS
UPTIMES_NS = {
    "32 bits of us": 2**32 * 1_000 - 700 * MS,
    "32 bits of ms": 2**32 * MS - 700 * MS,
    "53 bits of ns": 2**53 - 700 * MS,
    "1e9 cycles": 10**9 * CYCLE_NS,
}


class Shifted(Core):
    """A core whose clock has been running for a while when the bus begins."""

    def __init__(self, core, by_ns):
        self.core, self.by_ns = core, by_ns

    @property
    def cob_ids(self):
        return self.core.cob_ids

    def data_ids_on(self, bus):
        return self.core.data_ids_on(bus)

    @property
    def n_owed(self):
        return self.core.n_owed

    def take(self, now_ns, batch):
        batch.t_ns[: batch.n] += self.by_ns
        self.core.take(now_ns + self.by_ns, batch)

    def step(self, now_ns, frames):
        step = self.core.step(now_ns + self.by_ns, [f._replace(t_ns=f.t_ns + self.by_ns) for f in frames])
        wake_ns = step.wake_ns if step.wake_ns == NEVER else max(step.wake_ns - self.by_ns, 0)
        return step._replace(wake_ns=wake_ns)


def published(uptime_ns):
    """All frames of a bus on which master and patches have been up for so long."""
    rig = Rig("pad")
    rig.wire = wire = VirtualBus(rig.scene.arm.bus.bitrate)
    frames = []
    wire.tap(frames.append)
    wire.attach(rig.patches)
    wire.attach(Shifted(rig.master, uptime_ns))
    wire.run(1500 * MS)
    return [(frame.can_id, frame.data) for frame in frames]


@pytest.fixture(scope="module")
def fresh():
    return published(0)


@pytest.mark.parametrize("uptime_ns", UPTIMES_NS.values(), ids=UPTIMES_NS)
def test_what_is_published_does_not_depend_on_how_long_the_clock_has_run(fresh, uptime_ns):
    """The time wraps in the middle of the run where it is kept in too few bits."""
    assert any(0x681 <= can_id <= 0x690 for can_id, _ in fresh)
    assert published(uptime_ns) == fresh
