"""Errors of patches that nobody heard: the master asks for them, and shows them until they are over."""

import pytest

from skinbus.can.frame import Frame
from skinbus.objects import cia
from skinbus.objects.cia import EmcyCode
from tests.master.faults_rig import NODE, STATES, assert_all_well, emcy, wake
from tests.master.rig import MS, Rig


@pytest.fixture
def arm():
    """The forearm, running for half a second."""
    rig = Rig("forearm")
    rig.run(500)
    return rig


@pytest.mark.slow
@pytest.mark.parametrize("reset", [cia.NmtCommand.RESET_COMMUNICATION, cia.NmtCommand.RESET_NODE])
def test_emcy_between_boot_up_and_start_is_shown_until_the_patch_takes_it_back(arm, reset):
    device = arm.device(NODE)
    arm.say(Frame(cia.NMT_COMMAND_ID, bytes([reset, NODE])))
    row = arm.scene.arm.patch_at(NODE)
    while arm.master.table.state[row] != STATES.BOOTING and arm.wire.now_ns < 600 * MS:
        arm.run(0.1)
    device.emcy(0x5010)
    wake(arm)
    _, _, frames = arm.run(200)
    assert arm.state(NODE) == STATES.OPERATIONAL
    assert arm.master.device.get(0x2302, NODE) == 0x5010
    assert emcy(frames)[-1][0] == EmcyCode.NO_ERROR  # of its reboot: that is over
    assert arm.master.device.get(cia.ERROR_REGISTER, 0) != 0
    device.emcy_clear(0x5010)
    wake(arm)
    _, _, frames = arm.run(100)
    assert [code for code, _ in emcy(frames)] == [EmcyCode.NO_ERROR]
    assert arm.master.device.get(0x2302, NODE) == 0
    assert_all_well(arm)
