"""Bad zeros and tactels that cannot be right, on the bus: no contact of theirs, and they are named."""

import struct

import numpy as np
import pytest

from skinbus.estimate import Quality, TactelFault
from skinbus.objects import cia
from skinbus.objects.eds import load_eds
from skinbus.objects.profile import FAULTY, PATCH_FAULTY, PATCH_FAULTY_COUNT, index_of
from tests.master.rig import Rig

MASTER = 127
OD = load_eds("skin-master", MASTER)
MAP, _ = index_of(OD, PATCH_FAULTY)
COUNT, _ = index_of(OD, PATCH_FAULTY_COUNT)
NODE = 1


class Noise:
    """What a patch reads that nothing touches, four tactels at a time: 200 Pa in counts."""

    def __init__(self, seed=4):
        print("seed", seed)
        self.rng = np.random.default_rng(seed)
        self.forced = None
        """Readings (16,) that are sent instead; NaN where there are none."""

    def __call__(self, tpdo, counts):
        counts = counts + np.rint(26.0 * self.rng.standard_normal(4)).astype(int)
        if self.forced is None:
            return counts
        forced = self.forced[4 * tpdo : 4 * tpdo + 4]
        return np.where(np.isnan(forced), counts, np.nan_to_num(forced)).astype(int)

    def force(self, counts, tactels=slice(None)):
        self.forced = np.full(16, np.nan)
        self.forced[tactels] = counts


@pytest.fixture
def noise():
    return Noise()


def make_rig(noise, **settings):
    """A pad of one patch with noise; a finger presses it from 0.5 to 2.5 s of scene time."""
    rig = Rig("pad", **settings)
    rig.patches.changes[NODE] = noise
    return rig


def shown(rig):
    """Bit map and count of the patch, and the count of the arm, as clients read them."""
    device = rig.master.device
    return device.get(MAP, NODE), device.get(COUNT, NODE), device.get(*index_of(OD, FAULTY))


def emcys(frames):
    """Data of the EMCYs of the master about tactels: node-ID, first tactel, faults, count."""
    data = [bytes(frame.data) for frame in frames if frame.can_id == cia.EMCY_BASE + MASTER]
    return [tuple(d[3:7]) for d in data if struct.unpack("<H", d[:2])[0] == cia.EmcyCode.DEVICE_SPECIFIC]


def kinds(events):
    return [event.kind for event in events if "implausible" in event.kind]


def test_tactel_at_full_scale_is_no_contact_and_those_beside_it_say_so(noise):
    rig = make_rig(noise)
    rig.run(600)
    noise.force(32752, [0])
    reports, _, frames = rig.run(1500)
    assert emcys(frames) == [(NODE, 1, TactelFault.RAIL, 1)]
    assert shown(rig) == (1, 1, 1)
    late = [report.contacts for report in reports[-25:]]
    assert [len(contacts) for contacts in late] == [1] * 25, "the finger alone"
    contacts, arm = late[-1], rig.scene.arm
    to_contact = np.hypot(arm.tactel_s - contacts.s[0], arm.tactel_a - contacts.a[0])
    to_faulty = np.hypot(arm.tactel_s - arm.tactel_s[0], arm.tactel_a - arm.tactel_a[0])
    feel_it = rig.master.cycle.baseline.touched & (to_contact < 0.015)
    is_near = to_contact[0] < 0.015 or (feel_it & (to_faulty < 0.015)).any()
    assert bool(contacts.quality[0] & Quality.IMPAIRED) == bool(is_near)
