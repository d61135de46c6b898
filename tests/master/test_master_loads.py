"""What a master shows by SDO and, if asked, by a TPDO is that of its cycle: loads, quality of contacts."""

import struct

import numpy as np
import pytest

from skinbus.can.frame import Frame
from skinbus.objects import profile
from skinbus.objects.eds import load_eds
from tests.master.rig import Rig

pytestmark = pytest.mark.slow

OD = load_eds("skin-master", 127)
COB_ID, TPDO_18 = 0x691, 0x1811
QUALITY_COB_ID, TPDO_21 = 0x6A1, 0x1814


@pytest.fixture(scope="module")
def pressed():
    """The rig of a forearm that fingers press, and its frames since the TPDOs were enabled."""
    rig = Rig("forearm")
    rig.run(1500)
    start = len(rig.frames)
    for ms, tpdo, cob_id in ((100, TPDO_18, COB_ID), (1900, TPDO_21, QUALITY_COB_ID)):
        rig.say(Frame(0x600 + 127, struct.pack("<BHBI", 0x23, tpdo, 1, 0x40000000 | cob_id)))
        rig.run(ms)
    return rig.master, rig.reports, rig.frames[start:]


def shown(master, name, sub=1):
    index, member = profile.index_of(OD, name)
    return master.device.get(index, member or sub)


def test_objects_show_the_loads_of_the_newest_cycle(pressed):
    master, reports, _ = pressed
    loads, arm = reports[-1].loads, master.arm
    # 6, 8 and 12 N on boards of 10 mm: within what falls between tactels
    assert loads.force == pytest.approx(26.0, abs=3.0 * loads.force_sd)
    assert shown(master, profile.LOAD) == pytest.approx(loads.force, rel=1e-6)
    assert shown(master, "Load/Force sd") == pytest.approx(loads.force_sd, rel=1e-6)
    assert shown(master, "Load/Touched area") == pytest.approx(loads.area, rel=1e-6)
    assert shown(master, profile.LINK_LOAD) == pytest.approx(loads.links.force[0], rel=1e-6)
    assert shown(master, profile.LINK_LOAD_S) == pytest.approx(loads.links.s[0], rel=1e-6)
    by_node = [shown(master, profile.PATCH_LOAD, sub=node) for node in arm.node_id.tolist()]
    assert by_node == pytest.approx(loads.patches.force.tolist(), rel=1e-6)


def test_enabled_tpdo_carries_the_load_of_the_arm_in_every_cycle(pressed):
    _, reports, frames = pressed
    payloads = [frame.data for frame in frames if frame.can_id == COB_ID]
    assert len(payloads) >= 95
    force, sd, area = np.frombuffer(payloads[-1], np.dtype("<u4,<u2,<u2"))[0].tolist()
    loads = reports[-1].loads
    assert 0.01 * force == pytest.approx(loads.force, abs=0.006)
    assert 0.01 * sd == pytest.approx(loads.force_sd, abs=0.006)
    assert 1e-6 * area == pytest.approx(loads.area, abs=1e-6)


def test_enabled_tpdo_carries_how_sure_a_contact_is(pressed):
    _, reports, frames = pressed
    payloads = [frame.data for frame in frames if frame.can_id == QUALITY_COB_ID]
    quality, place_sd, force_sd, identity, link_state = payloads[-1]
    row = reports[-1].ids.tolist().index(identity)
    contacts = reports[-1].contacts
    variances, _ = np.linalg.eigh(contacts.covariance[row, :2, :2])
    assert 0.1 * place_sd == pytest.approx(1e3 * np.sqrt(variances.max()) + 0.05, abs=0.051)
    assert 0.05 * force_sd == pytest.approx(np.sqrt(contacts.covariance[row, 2, 2]) + 0.025, abs=0.026)
    assert quality == contacts.quality[row]
    first = next(frame.data for frame in reversed(frames) if frame.can_id == 0x681)
    assert (identity, link_state) == (first[0], first[1])
