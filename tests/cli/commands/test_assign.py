"""`skinbus scan assign`: a patch without node-ID gets one from the arm file."""

import pytest

from skinbus.cli.commands.assign import wanted_by
from skinbus.config.system import load_arm
from skinbus.master.commissioning.node_id_assignment import Address, Known
from skinbus.node import Device
from skinbus.objects.eds import load_eds
from tests.files import put

ARM = """
[arm]
name = "two"
rate_hz = 50.0
[[link]]
name = "plate"
surface = "plane"
length_mm = 110.0
width_mm = 50.0
[[patch]]
node_id = 21
link = "plate"
s_mm = 27.0
serial = 4711
[[patch]]
node_id = 22
link = "plate"
s_mm = 80.0
"""
IDENTITY = (0x534B4E42, 0x5001, 0x10000)


@pytest.fixture
def arm_file(tmp_path):
    return put(tmp_path, "two.toml", ARM)


def test_arm_file_says_who_is_known_by_serial_number(arm_file):
    known, free = wanted_by(load_arm(arm_file))
    assert known == [Known(Address(*IDENTITY, 4711), 21)]
    assert free == [22]


@pytest.mark.slow
def test_patches_get_the_node_ids_of_the_arm_file(own_bus, arm_file):
    devices = [Device(load_eds("skin-patch", 1, serial=serial), 255, storage={}) for serial in (815, 4711)]
    with own_bus.with_cores(*devices):
        # more time for an answer than usual: a busy machine may hold the devices up
        answer = own_bus.run("scan", "assign", arm_file, "--timeout-ms", "100")
    assert [line.partition("-> ")[2] for line in answer.splitlines()] == [
        "node 21: assigned",
        "node 22: assigned",
    ]
    assert [device.node_id for device in devices] == [22, 21]


def test_nobody_on_the_bus_is_status_1_and_said(own_bus):
    assert "no node answers: is the bus powered" in own_bus.run("scan", "assign", status=1)
