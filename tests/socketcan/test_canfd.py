"""CAN FD on a real kernel: one frame a patch from sim to run, what the doctor says, what a monitor sees."""

import json

import pytest

from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.frame import BRS, FD
from tests.cli.patience import PATIENCE_S, until_in_time
from tests.fd_arm import PRESS_S, write_arm, write_scene_file
from tests.socketcan.can_rig import ip, set_up
from tests.socketcan.processes import end, master_on, wait_for, wait_for_patches
from tests.socketcan.skin_rig import SYNC


def test_sim_run_and_monitor_on_can_fd(start, channel, tmp_path):
    scene, arm = write_scene_file(tmp_path, "skin-patch-fd32"), tmp_path / "fd.toml"
    sim = start("sim", str(scene), "--channel", channel)
    run = start("run", str(arm), "--channel", channel, "--quiet")
    with master_on(channel) as master:
        wait_for_patches(master, 2)
        wait_for(lambda: master["Contact 1"]["s"].raw == pytest.approx(PRESS_S, abs=2e-3))
        assert master["Frames"]["Bad length"].raw == 0
    with SocketCanBus(channel, fd=True) as observer:
        frames = []
        while sum(frame.can_id == SYNC for frame in frames) < 10:
            frames += observer.receive(1.0)
    readings = [frame for frame in frames if frame.can_id in (0x181, 0x182)]
    assert {(len(frame.data), frame.flags) for frame in readings} == {(64, FD | BRS)}
    assert all(frame.flags == 0 for frame in frames if frame not in readings)

    def contacts():
        monitor = start("monitor", str(arm), "--channel", channel, "--seconds", "2", "--json-lines")
        out, _ = monitor.communicate(timeout=PATIENCE_S)
        assert monitor.returncode == 0, out
        lines = [line for line in out.splitlines() if line.startswith("{")]
        return [seen for line in lines for seen in json.loads(line)["contacts"]]

    assert until_in_time(contacts, bool)  # without one, the patches were held up for so long
    end(run)
    said, _ = start("doctor", str(arm), "--channel", channel).communicate(timeout=PATIENCE_S)
    end(sim)
    assert "ok   CAN FD " in said


def test_run_and_doctor_say_what_a_classic_interface_lacks(start, channel, tmp_path):
    arm = write_arm(tmp_path, "skin-patch-fd")
    set_up(channel, False)
    ip("link", "set", channel, "mtu", "16")
    set_up(channel, True)
    run = start("run", str(arm), "--channel", channel)
    out, _ = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 3
    assert "it is not a CAN FD interface (mtu 16)" in out
    doctor = start("doctor", str(arm), "--channel", channel)
    out, _ = doctor.communicate(timeout=PATIENCE_S)
    assert doctor.returncode == 1
    steps = ("down", "mtu 72", "up")
    assert f"-> {'; '.join(f'ip link set {channel} {step}' for step in steps)}" in out
