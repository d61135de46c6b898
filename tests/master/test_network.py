"""The network list of the master, as any CANopen client reads it."""

import struct

import pytest

from skinbus.config.system import load_arm, ods_of
from skinbus.master import Master
from skinbus.master.network import MISSING
from skinbus.objects import cia
from skinbus.objects.dcf import configuration
from tests.master.commission import Bench
from tests.master.sdo_reads import MASTER, number, read, transfer
from tests.objects.inverse import from_concise


@pytest.mark.slow
def test_expected_identities_and_watches_are_those_of_the_arm_file(forearm):
    forearm.run(200)
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


@pytest.mark.slow
def test_nmt_states_are_live(forearm):
    forearm.run(500)
    assert number(forearm.master, cia.REQUEST_NMT, 5) == cia.NmtState.OPERATIONAL
    assert number(forearm.master, cia.REQUEST_NMT, MASTER) == cia.NmtState.OPERATIONAL
    assert number(forearm.master, cia.REQUEST_NMT, 60) == 0
    forearm.patches.unplugged = {5}
    forearm.run(5000)
    assert number(forearm.master, cia.REQUEST_NMT, 5) == MISSING
    device = forearm.device(7)
    device.set(cia.IDENTITY, cia.IDENTITY_PRODUCT, 0xBAD)
    device.command(cia.NmtCommand.RESET_NODE)
    forearm.run(1500)
    assert number(forearm.master, cia.REQUEST_NMT, 7) == cia.NmtState.PRE_OPERATIONAL


def test_the_arm_file_has_the_last_word(rig):
    rig.run(100)
    for index in (cia.NMT_ASSIGNMENT, cia.HEARTBEAT_CONSUMER, cia.EXPECTED_SERIAL):
        result = transfer(rig.master, lambda client, index=index: client.start_write(index, 1, b"\0\0\0\0"))
        assert result.abort == cia.AbortCode.LOCAL_CONTROL
    assert number(rig.master, cia.NMT_ASSIGNMENT, 1) == 0b101


def test_list_is_there_again_after_a_reset_of_the_master(rig):
    rig.run(100)
    rig.master.device.command(cia.NmtCommand.RESET_NODE)
    rig.run(1500)
    assert number(rig.master, cia.NMT_ASSIGNMENT, 1) == 0b101
    assert rig.reports[-1].n_fresh == 1


def test_lost_patch_is_one_emcy_8130_though_1016_names_it(rig):
    rig.run(500)
    rig.patches.unplugged = {1}
    _, _, frames = rig.run(3000)
    codes = [struct.unpack_from("<H", f.data)[0] for f in frames if f.can_id == cia.EMCY_BASE + MASTER]
    assert codes.count(cia.EmcyCode.HEARTBEAT) == 1
    assert rig.master.device.nmt_state is cia.NmtState.OPERATIONAL


def test_configuration_that_is_downloaded_can_be_read_as_concise_dcf(tmp_path):
    arm_file = tmp_path / "one.toml"
    arm_file.write_text(
        '[arm]\nname = "one"\nrate_hz = 50.0\n[[link]]\nname = "plate"\nsurface = "plane"\n'
        "length_mm = 50.0\nwidth_mm = 50.0\n"
        '[[patch]]\nnode_id = 9\nlink = "plate"\ns_mm = 25.0\n[patch.set]\n"Touch Pa" = 1234\n'
    )
    arm = load_arm(arm_file)
    master = Master(arm)
    Bench(master).pass_ms(50)
    wanted = configuration(ods_of(arm)[0])
    assert from_concise(read(master, cia.CONCISE_DCF, 9).unwrap()) == list(wanted.writes)
    assert number(master, cia.EXPECTED_DATE, 9) == wanted.date
    assert number(master, cia.EXPECTED_TIME, 9) == wanted.time
