"""CAN FD from the arm file to the contact: one frame carries all readings of a patch."""

import pytest

from skinbus.can.fd import worst_case_bits
from skinbus.can.frame import BRS, FD
from skinbus.can.wire_bits import frame_bits
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import ConfigError
from skinbus.objects.bus_load import cyclic_load
from tests.fd_arm import PATCHES, PRESS_S, write_arm, write_scene_file
from tests.master.rig import MS, Rig


@pytest.mark.parametrize(("eds", "n"), PATCHES)
def test_a_cycle_is_one_frame_a_patch_and_finds_the_press(tmp_path, eds, n):
    rig = Rig(write_scene_file(tmp_path, eds))
    arm = rig.scene.arm
    rig.run(1000)
    reports, _, frames = rig.run(1000)
    readings = [frame for frame in frames if frame.can_id in (0x181, 0x182)]
    assert {len(frame.data) for frame in readings} == {{16: 48, 32: 64}[n]}, "readings and a stamp"
    assert {frame.flags for frame in readings} == {FD | BRS}
    assert len(readings) == 2 * len(reports)
    assert all(frame.flags == 0 for frame in frames if frame.can_id not in (0x181, 0x182))
    assert reports[-1].n_fresh == 2
    (contact,) = reports[-1].contacts.s
    assert contact == pytest.approx(PRESS_S, abs=2e-3)
    rates = arm.bus.bitrate, arm.bus.data_bitrate
    long = [worst_case_bits(len(frame.data)).ns(*rates) for frame in readings]
    busy = sum(long) + sum(1000 * frame_bits(frame) for frame in frames if not frame.flags & FD)
    assert busy / (1000 * MS) <= cyclic_load(arm, ods_of(arm)) + 0.01, "heartbeats beside the cycle"


def test_a_patch_for_can_fd_on_a_classic_bus_is_refused(tmp_path):
    with pytest.raises(
        ConfigError, match=r"TPDO 1: is '48 bytes'; wanted at most 8, or a bus with canfd = true"
    ):
        load_arm(write_arm(tmp_path, "skin-patch-fd", canfd=""))
