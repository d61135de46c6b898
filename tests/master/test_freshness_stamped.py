"""CAN FD: the stamp of a frame says which SYNC it was sampled for, without an account and without a gap."""

import numpy as np
import pytest

from skinbus.objects.profile import SampleStatus
from tests.fd_arm import write_scene_file
from tests.master.heard import listen
from tests.master.misbehaving import Delayed
from tests.master.rig import MS, Rig

pytestmark = pytest.mark.slow

PERIOD_MS = 20
READINGS = {0x181, 0x182}


class Late(Delayed):
    """A world whose readings are late by ``periods``."""

    periods = 0.0

    def later(self, now_ns, frame):
        return [(now_ns + (frame.can_id in READINGS) * self.periods * PERIOD_MS * MS, frame)]


def stamped(folder, counter=240):
    """A rig on CAN FD whose patches run; with ``counter`` its SYNC has a counter, which the stamps carry."""
    path = write_scene_file(folder, "skin-patch-fd")
    arm = folder / "fd.toml"
    arm.write_text(arm.read_text().replace("rate_hz", f"sync_counter = {counter}\nrate_hz", 1))
    rig = Rig(path, Late)
    rig.run(1000)
    return rig


@pytest.mark.parametrize("periods", [1.05, 2.3])
def test_frames_of_an_earlier_sync_are_never_fresh_and_those_of_this_one_are_at_once(tmp_path, periods):
    rig = stamped(tmp_path)
    assert rig.fresh(200).all()
    rig.patches.periods = periods
    rig.run((periods + 1) * PERIOD_MS)
    assert rig.fresh(2000).max() == 0.0
    rig.patches.periods = 0.0
    rig.run((periods + 1) * PERIOD_MS)
    n = len(rig.frames)
    assert (rig.fresh(1000) == 1.0).all()
    syncs = [frame.t_ns for frame in rig.frames[n:] if frame.can_id == 0x080]
    assert np.diff(syncs).max() < 1.5 * PERIOD_MS * MS, "no gap is needed"


@pytest.mark.parametrize(("status", "counter"), [(SampleStatus.OLD, 0), (SampleStatus.UNSETTLED, 240)])
def test_sample_that_says_it_is_old_or_unsettled_is_not_used(tmp_path, status, counter):
    rig = stamped(tmp_path, counter)
    rig.world.devices[0].sample_status = status
    _, feed = listen(rig)
    rig.run(2 * PERIOD_MS)
    assert rig.fresh(1000).tolist() == [0.0, 1.0]
    assert (feed.peek().readings.valid == rig.scene.arm.tactel_patch).all()
    rig.world.devices[0].sample_status = SampleStatus(0)
    rig.run(2 * PERIOD_MS)
    assert (rig.fresh(1000) == 1.0).all()
