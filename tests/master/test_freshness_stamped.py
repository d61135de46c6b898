"""CAN FD: the stamp of a frame says which SYNC it was sampled for, without an account and without a gap."""

import numpy as np
import pytest

from skinbus.can.virtual_bus import VirtualBus
from skinbus.master import Master
from skinbus.objects.profile import SampleStatus
from skinbus.sim import World, load_scene
from tests.fd_arm import write_scene_file
from tests.master.misbehaving import Delayed

MS = 1_000_000
PERIOD_MS = 20
READINGS = {0x181, 0x182}


class Late(Delayed):
    """A world whose readings are late by ``periods``."""

    periods = 0.0

    def later(self, now_ns, frame):
        return [(now_ns + (frame.can_id in READINGS) * self.periods * PERIOD_MS * MS, frame)]


class StampedRig:
    """A master on a CAN FD bus; with ``counter`` its SYNC has a counter, which the stamps carry."""

    def __init__(self, folder, counter):
        path = write_scene_file(folder, "skin-patch-fd")
        arm = folder / "fd.toml"
        arm.write_text(arm.read_text().replace("rate_hz", f"sync_counter = {counter}\nrate_hz", 1))
        scene = load_scene(path)
        self.world = World(scene)
        self.patches = Late(self.world)
        self.cycles, self.syncs = [], []
        self.wire = VirtualBus(scene.arm.bus.bitrate, data_bitrate=scene.arm.bus.data_bitrate)
        self.wire.attach(self.patches)
        self.wire.attach(Master(scene.arm, on_cycle=self.cycles.append))
        self.wire.tap(lambda frame: self.syncs.append(frame.t_ns) if frame.can_id == 0x080 else None)
        self.run(3000)

    def run(self, ms):
        """Return the share of the cycles of that time in which each patch was fresh."""
        n = len(self.cycles)
        self.wire.run(self.wire.clock.now_ns() + round(ms * MS))
        return np.mean([cycle.fresh for cycle in self.cycles[n:]], axis=0)


@pytest.fixture
def rig(tmp_path):
    return StampedRig(tmp_path, 240)


@pytest.mark.parametrize("periods", [1.05, 1.5, 2.3])
def test_frames_of_an_earlier_sync_are_never_fresh_and_those_of_this_one_are_at_once(rig, periods):
    assert rig.run(200).all()
    rig.patches.periods = periods
    rig.run((periods + 1) * PERIOD_MS)
    assert rig.run(2000).max() == 0.0
    rig.patches.periods = 0.0
    rig.run((periods + 1) * PERIOD_MS)
    n = len(rig.syncs)
    assert (rig.run(1000) == 1.0).all()
    assert np.diff(rig.syncs[n:]).max() < 1.5 * PERIOD_MS * MS, "no gap is needed"


@pytest.mark.parametrize("status", [SampleStatus.OLD, SampleStatus.UNSETTLED])
@pytest.mark.parametrize("counter", [0, 240])
def test_sample_that_says_it_is_old_or_unsettled_is_not_used(tmp_path, status, counter):
    rig = StampedRig(tmp_path, counter)
    rig.world.devices[0].sample_status = status
    rig.run(2 * PERIOD_MS)
    assert rig.run(1000).tolist() == [0.0, 1.0]
    rig.world.devices[0].sample_status = SampleStatus(0)
    rig.run(2 * PERIOD_MS)
    assert (rig.run(1000) == 1.0).all()
