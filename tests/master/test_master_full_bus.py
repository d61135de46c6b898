"""A full bus: 126 patches on 1 Mbit/s boot about as fast as their frames can cross the wire, and run."""

import pytest

from skinbus.can.wire_bits import frame_bits
from skinbus.objects import cia
from tests.master.rig import Rig
from tests.socketcan.many import many_patches

pytestmark = pytest.mark.slow

N_PATCHES = 126
RATE_HZ = 10.0
BITRATE = 1_000_000

MAX_RATIO = 1.5
"""Time to operational over the time that the frames of the boots take."""

TRANSFERS_PER_BOOT = 9
"""Device type, vendor, product, revision, configuration date and time, checksum, synchronous window, error
register."""
FRAMES_PER_BOOT = 1 + 2 * TRANSFERS_PER_BOOT + 1
"""Its boot-up message, requests and answers, and the start command."""


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    _, scene = many_patches(tmp_path_factory.mktemp("full"), RATE_HZ)
    rig = Rig(scene)
    rig.run(1000)
    return rig


def is_of_boot(frame):
    sdo = cia.SDO_SERVER_BASE < frame.can_id < cia.SDO_CLIENT_BASE + 0x80
    boot_up = frame.can_id > cia.HEARTBEAT_BASE and frame.data == b"\0"
    return frame.can_id == cia.NMT_COMMAND_ID or sdo or boot_up


def test_126_patches_are_operational_about_as_fast_as_their_frames_can_cross_the_wire(full):
    boot = [frame for frame in full.frames if is_of_boot(frame)]
    # Nothing is said twice: what crosses is what must, and the reset and the boot-up message of the master.
    assert len(boot) == N_PATCHES * FRAMES_PER_BOOT + 2
    bound_s = sum(map(frame_bits, boot)) / BITRATE
    last_start_s = 1e-9 * max(frame.t_ns for frame in boot if frame.can_id == cia.NMT_COMMAND_ID)
    ratio = last_start_s / bound_s
    assert {d.nmt_state for d in full.world.devices} == {cia.NmtState.OPERATIONAL}
    assert 1.0 <= ratio <= MAX_RATIO


def test_all_are_fresh_in_every_cycle_and_in_time(full):
    n = len(full.frames)
    cycles, events, _ = full.run(2000)
    assert len(cycles) == 2.0 * RATE_HZ
    assert {cycle.n_fresh for cycle in cycles} == {N_PATCHES}
    assert not [event for event in events if event.node_id]
    assert sum(map(frame_bits, full.frames[n:])) / (2 * BITRATE) < 0.8
    assert max(cycle.latency_ns for cycle in cycles) < 1e9 / RATE_HZ
