"""`skinbus scan assign` as a process: a patch without node-ID gets one from the arm file."""

import json
import threading
from contextlib import contextmanager

import pytest

from skinbus.bus.loop import run_core
from skinbus.bus.pythoncan import PythonCanBus
from skinbus.cli.commands.assign import wanted_by
from skinbus.config.system import load_arm
from skinbus.master.commissioning.node_id_assignment import Address, Known
from skinbus.node import Device
from skinbus.node.storage import MemoryStorage
from skinbus.objects.eds import load_eds
from tests.cli.patience import PATIENCE_S, TRIES, complaints

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
    (tmp_path / "two.toml").write_text(ARM)
    return tmp_path / "two.toml"


@pytest.fixture
def plug(group):
    """Puts devices on the bus, each in a thread of its own, for the time of a ``with``."""

    @contextmanager
    def plugged(*devices):
        stop = threading.Event()
        threads = [
            threading.Thread(
                target=run_core,
                args=(device, lambda: PythonCanBus("udp_multicast", group)),
                kwargs={"stop": stop},
            )
            for device in devices
        ]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            stop.set()
            for thread in threads:
                thread.join()

    return plugged


def test_arm_file_says_who_is_known_by_serial_number(arm_file):
    known, free, hints = wanted_by(load_arm(arm_file))
    assert known == [Known(Address(*IDENTITY, 4711), 21)]
    assert free == [22]
    assert hints == [IDENTITY]


@pytest.mark.slow
def test_patches_get_the_node_ids_of_the_arm_file(skinbus, group, arm_file, tmp_path, plug):
    file = tmp_path / "nodes.json"
    bus = ("--interface", "udp_multicast", "--channel", group)
    for _ in range(TRIES):
        devices = [
            Device(load_eds("skin-patch", 1, serial=serial), 255, storage=MemoryStorage())
            for serial in (815, 4711)
        ]
        with plug(*devices):
            # More time for an answer than usual: a busy machine may hold the devices up.
            assign = skinbus(
                "scan", "assign", str(arm_file), *bus, "--timeout-ms", "150", "--json", str(file)
            )
            out, err = assign.communicate(timeout=PATIENCE_S)
        if assign.returncode == 0:  # else an answer was held up for longer than that
            break
    assert assign.returncode == 0, out + err
    rows = json.loads(file.read_text())["nodes"]
    assert [(row["node_id"], row["identity"]["serial"], row["outcome"]) for row in rows] == [
        (21, 4711, "assigned"),
        (22, 815, "assigned"),
    ]
    assert [device.node_id for device in devices] == [22, 21]


@pytest.mark.slow
def test_nobody_on_the_bus_is_status_1_and_said(skinbus, group):
    assign = skinbus("scan", "assign", "--first", "5", "--interface", "udp_multicast", "--channel", group)
    out, err = assign.communicate(timeout=PATIENCE_S)
    assert (assign.returncode, complaints(err)) == (1, [])
    assert "no node answers: is the bus powered" in out


def test_first_and_an_arm_file_contradict_each_other(skinbus):
    assign = skinbus("scan", "assign", "pad", "--first", "5")
    _, err = assign.communicate(timeout=PATIENCE_S)
    assert assign.returncode == 2
    assert "--first" in err
