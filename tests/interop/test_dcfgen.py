"""Configurations that lely's dcfgen makes from our EDS files are accepted by our devices."""

import struct
import subprocess
import sys

import pytest

from skinbus.can.frame import Frame
from skinbus.node import Device
from skinbus.objects.cia import NmtCommand
from skinbus.objects.eds import load_eds
from tests.files import put
from tests.lely import dcfchk, for_lely
from tests.master.sdo_reads import read, write

MASTER = 127
BUS = """
options:
  dcf_path: "."
master:
  node_id: {master}
  baudrate: 1000
  sync_period: 20000
  heartbeat_producer: 500
slow:
  node_id: 1
  dcf: {patch}
  heartbeat_producer: 250
  sdo:
    - {{index: 0x2030, sub_index: 1, value: 3000}}
    - {{index: 0x6423, sub_index: 0, value: 1}}
  tpdo:
    1: {{transmission: 0x02, inhibit_time: 50}}
    2: {{transmission: 0xFE, event_timer: 100}}
    4: {{enabled: false}}
narrow:
  node_id: 2
  dcf: {patch_8bit}
  tpdo:
    2: {{transmission: 0x00}}
plain:
  node_id: 3
  dcf: {patch}
"""


def started(eds, node_id):
    """A patch that has booted."""
    device = Device(load_eds(eds, node_id), node_id)
    device.step(0)
    return device


def concise_entries(data):
    """Index, sub-index and value of a concise DCF. Source: CiA 302-3, object 0x1F22."""
    (n,) = struct.unpack_from("<I", data)
    position = 4
    for _ in range(n):
        index, sub, size = struct.unpack_from("<HBI", data, position)
        position += 7
        yield index, sub, data[position : position + size]
        position += size
    assert position == len(data)


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    """What dcfgen makes of a bus with three of our patches."""
    folder = tmp_path_factory.mktemp("dcfgen")
    names = {"patch": for_lely("skin-patch", folder), "patch_8bit": for_lely("skin-patch-8bit", folder)}
    bus = put(folder, "bus.yml", BUS.format(master=MASTER, **names))
    run = subprocess.run(
        [sys.executable, "-m", "dcfgen.cli", "-r", "-d", folder, bus],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert "Traceback" not in run.stderr
    return folder


def test_generated_master_is_clean_under_dcfchk(generated, tmp_path):
    run = dcfchk(generated / "master.dcf", tmp_path, MASTER)
    assert (run.returncode, run.stdout) == (0, "")


@pytest.mark.parametrize(
    ("name", "eds", "node_id"), [("slow", "skin-patch", 1), ("narrow", "skin-patch-8bit", 2)]
)
def test_patch_accepts_every_entry_of_its_generated_configuration(generated, name, eds, node_id):
    device = started(eds, node_id)
    entries = list(concise_entries((generated / f"{name}.bin").read_bytes()))
    assert len(entries) >= 2
    for index, sub, data in entries:
        write(device, index, sub, data).unwrap()
    # What was written last is what can be read.
    for (index, sub), data in {(index, sub): data for index, sub, data in entries}.items():
        assert read(device, index, sub) == data


def test_generated_configuration_has_the_wanted_effect(generated):
    device = started("skin-patch", 1)
    for index, sub, data in concise_entries((generated / "slow.bin").read_bytes()):
        write(device, index, sub, data).unwrap()
    assert device.get(0x1017, 0) == 250
    assert device.get(0x2030, 1) == 3000
    assert (device.get(0x1800, 2), device.get(0x1800, 3)) == (2, 50)
    assert (device.get(0x1801, 2), device.get(0x1801, 5)) == (0xFE, 100)
    assert device.get(0x1803, 1) & 0x8000_0000
    device.command(NmtCommand.START)
    ids = [frame.can_id for k in (1, 2) for frame in device.step(k * 20_000_000, [Frame(0x080)]).frames]
    assert ids.count(0x181) == 1  # every second SYNC
    assert ids.count(0x381) == 2
    assert ids.count(0x481) == 0
