"""CAN FD from the arm file to the contact: one frame carries all readings of a patch."""

import threading

import pytest

from skinbus.bus.loop import run_core
from skinbus.bus.pythoncan import PythonCanBus
from skinbus.can.fd_bits import frame_ns
from skinbus.can.frame import BRS, FD
from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.system import load_arm, ods_of
from skinbus.errors import ConfigError
from skinbus.master import Master
from skinbus.objects.bus_load import cyclic_load
from skinbus.sim import World
from tests.fd_arm import PATCHES, PRESS_S, write_arm, write_scene

MS = 1_000_000


@pytest.mark.parametrize(("eds", "n"), PATCHES)
def test_a_cycle_is_one_frame_a_patch_and_finds_the_press(tmp_path, eds, n):
    scene = write_scene(tmp_path, eds)
    bus = scene.arm.bus
    reports, frames = [], []
    wire = VirtualBus(bus.bitrate, data_bitrate=bus.data_bitrate)
    wire.tap(frames.append)
    wire.attach(World(scene))
    wire.attach(Master(scene.arm, on_cycle=reports.append))
    wire.run(1000 * MS)
    begun, n_cycles = len(frames), len(reports)
    wire.run(2000 * MS)
    readings = [frame for frame in frames[begun:] if frame.can_id in (0x181, 0x182)]
    assert {len(frame.data) for frame in readings} == {{16: 48, 32: 64}[n]}, "readings and a stamp"
    assert {frame.flags for frame in readings} == {FD | BRS}
    assert len(readings) == 2 * (len(reports) - n_cycles)
    assert all(frame.flags == 0 for frame in frames[begun:] if frame.can_id not in (0x181, 0x182))
    assert reports[-1].n_fresh == 2
    (contact,) = reports[-1].contacts.s
    assert contact == pytest.approx(PRESS_S, abs=2e-3)
    busy = sum(frame_ns(frame, bus.bitrate, bus.data_bitrate) for frame in frames[begun:])
    assert (
        busy / (1000 * MS) <= cyclic_load(scene.arm, ods_of(scene.arm)) + 0.01
    )  # heartbeats beside the cycle


@pytest.mark.parametrize(("eds", "n"), PATCHES)
def test_the_same_on_the_virtual_bus_of_python_can(tmp_path, eds, n):
    scene = write_scene(tmp_path, eds)
    stop = threading.Event()
    reports = []

    def on_cycle(report):
        reports.append(report)
        if report.n_fresh == 2 and len(report.contacts):
            stop.set()

    def run(core):
        run_core(core, lambda: PythonCanBus("virtual", f"fd-{n}", fd=True), stop=stop)

    cores = World(scene), Master(scene.arm, on_cycle=on_cycle)
    threads = [threading.Thread(target=run, args=(core,)) for core in cores]
    for thread in threads:
        thread.start()
    found = stop.wait(300.0)
    stop.set()
    for thread in threads:
        thread.join()
    assert found, f"{len(reports)} cycles without a contact"


def test_a_patch_for_can_fd_on_a_classic_bus_is_refused(tmp_path):
    with pytest.raises(
        ConfigError, match=r"TPDO 1: is '48 bytes'; wanted at most 8, or a bus with canfd = true"
    ):
        load_arm(write_arm(tmp_path, "skin-patch-fd", canfd=""))


def test_sixteen_readings_and_a_stamp_take_a_quarter_of_the_time_of_four_frames(tmp_path):
    loads = []
    for eds in ("skin-patch", "skin-patch-fd"):
        arm = load_arm(write_arm(tmp_path, eds))
        ods = ods_of(arm)
        alone = arm.bus.rate_hz * 17 * 135e-6 + arm.bus.rate_hz * 65e-6  # what the master sends, and SYNC
        loads.append(cyclic_load(arm, ods) - alone)
    assert loads[0] / loads[1] == pytest.approx(4 * 135 / 137.6, rel=1e-3)
