"""An arm of 24 boards whose firmware is the C: what a master and a guard have from it."""

import pytest

from skinbus.node import Device
from tests.bench.guard_trials import load_forearm
from tests.firmware.firmware_device import EMPTY, FirmwareDevice, code_of
from tests.guard.rig import MS
from tests.guard.whole import Whole
from tests.master.rig import Rig

pytestmark = pytest.mark.slow


def firmware(od, node_id, storage):
    """A board in place of a simulated patch."""
    return FirmwareDevice(code_of("skin-patch"), node_id, flash=bytearray(EMPTY))


def test_a_scene_gives_the_frames_and_contacts_that_simulated_patches_give(monkeypatch):
    runs = []
    for device in (Device, firmware):
        monkeypatch.setattr("skinbus.sim.world.Device", device)
        reports, _, frames = Rig("forearm").run(3000)
        contacts = [(report.ids.tolist(), report.contacts.force.tolist()) for report in reports]
        runs.append(([frame[:2] for frame in frames], contacts))
    assert runs[0] == runs[1]
    assert sum(len(ids) for ids, _ in contacts) > 100


@pytest.mark.parametrize("tactels", [[100], range(0, 384, 16)], ids=["one", "all boards"])
def test_boards_with_limits_are_armed_and_a_press_stops_the_robot(monkeypatch, tmp_path, tactels):
    monkeypatch.setattr("tests.guard.whole.Device", firmware)
    whole = Whole(load_forearm(tmp_path)).until_guarding(100)
    begun_ns = whole.now_ns
    whole.press([*tactels], 45.0)
    whole.run(40)  # the drive is told after EMCY messages and readings
    assert whole.told_ns()
    assert begun_ns < min(whole.gfc_ns()) <= min(whole.stops_ns()) < begun_ns + 2 * MS
