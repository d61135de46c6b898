"""Long uptimes: counters wrap, clocks grow, and nothing that is published notices."""

import pytest

from skinbus.can.virtual_bus import VirtualBus
from tests.master.rig import MS, Rig

CYCLE_NS = 20 * MS
UPTIMES_NS = {
    "32 bits of us": 2**32 * 1_000 - 700 * MS,
    "32 bits of ms": 2**32 * MS - 700 * MS,
    "53 bits of ns": 2**53 - 700 * MS,
    "1e9 cycles": 10**9 * CYCLE_NS,
}


def published(uptime_ns):
    """All frames of a bus on which master and patches have been up for so long."""
    rig = Rig("pad")
    rig.wire = wire = VirtualBus(rig.scene.arm.bus.bitrate)
    frames = []
    wire.tap(frames.append)
    wire.run(uptime_ns)
    wire.attach(rig.patches)
    wire.attach(rig.master)
    wire.run(uptime_ns + 1200 * MS)
    return [(frame.can_id, frame.data) for frame in frames]


@pytest.mark.slow
def test_what_is_published_does_not_depend_on_how_long_the_clock_has_run():
    """The time wraps in the middle of the run where it is kept in too few bits."""
    fresh = published(0)
    assert any(0x681 <= can_id <= 0x690 for can_id, _ in fresh)
    for name, uptime_ns in UPTIMES_NS.items():
        assert published(uptime_ns) == fresh, name
