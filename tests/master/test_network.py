"""The network list of the master, as any CANopen client reads it."""

import pytest

from skinbus.config.system import ods_of
from skinbus.master.network import MISSING
from skinbus.objects import cia
from tests.master.rig import Rig
from tests.master.sdo_reads import MASTER, number

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def forearm():
    rig = Rig("forearm", level="kmeans")
    rig.run(500)
    return rig


def test_expected_identities_and_watches_are_those_of_the_arm_file(forearm):
    master = forearm.master
    for od in ods_of(forearm.scene.arm)[:3]:
        node = od.node_id
        assert number(master, cia.NMT_ASSIGNMENT, node) == 0b101
        assert number(master, cia.EXPECTED_DEVICE_TYPE, node) == 0x00040191
        for index, sub in ((cia.EXPECTED_VENDOR, 1), (cia.EXPECTED_PRODUCT, 2), (cia.EXPECTED_REVISION, 3)):
            assert number(master, index, node) == od[cia.IDENTITY][sub].default
        assert number(master, cia.HEARTBEAT_CONSUMER, node) == node << 16 | 1500
        assert number(master, cia.EMCY_CONSUMER, node) == 0x80 + node
    absent = 60
    assert number(master, cia.NMT_ASSIGNMENT, absent) == 0
    assert number(master, cia.EMCY_CONSUMER, absent) == 0x80000000


def test_nmt_states_are_live(forearm):
    assert number(forearm.master, cia.REQUEST_NMT, 5) == cia.NmtState.OPERATIONAL
    assert number(forearm.master, cia.REQUEST_NMT, MASTER) == cia.NmtState.OPERATIONAL
    assert number(forearm.master, cia.REQUEST_NMT, 60) == 0
    forearm.patches.unplugged = {5}
    forearm.run(3500)
    assert number(forearm.master, cia.REQUEST_NMT, 5) == MISSING
    device = forearm.device(7)
    device.set(cia.IDENTITY, cia.IDENTITY_PRODUCT, 0xBAD)
    device.command(cia.NmtCommand.RESET_NODE)
    forearm.run(1500)
    assert number(forearm.master, cia.REQUEST_NMT, 7) == cia.NmtState.PRE_OPERATIONAL
