"""The commands on a real interface: patches in one process, the master in another, the doctor beside."""

import json
import signal
import subprocess
import sys
import time

import canopen
from can_rig import EDS, ip
from many import many_patches

PATIENCE_S = 90.0


def start(*words):
    return subprocess.Popen(
        [sys.executable, "-m", "skinbus", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def end(process):
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, out
    assert "Traceback" not in out
    return out


def wait_for_patches(channel, n):
    """Wait until the master says that patches 1 to n are operational."""
    network = canopen.Network()
    network.connect(interface="socketcan", channel=channel)
    node = network.add_node(127, str(EDS / "skin-master.eds"))
    give_up_s = time.monotonic() + PATIENCE_S
    states = []
    while states != [4] * n:
        assert time.monotonic() < give_up_s, states
        try:
            states = [node.sdo["Patch state"][number].raw for number in range(1, n + 1)]
        except canopen.SdoCommunicationError:
            time.sleep(0.1)
    network.disconnect()


def test_sim_and_run_and_doctor_on_one_interface(channel, tmp_path):
    sim = start("sim", "forearm", "--channel", channel, "--seconds", str(PATIENCE_S))
    run = start("run", "forearm", "--channel", channel, "--quiet", "--json", str(tmp_path / "run.json"))
    wait_for_patches(channel, 24)
    assert "stopping" in end(run)
    doctor = start("doctor", "forearm", "--channel", channel, "--json", str(tmp_path / "doctor.json"))
    doctor.communicate(timeout=PATIENCE_S)
    end(sim)

    summary = json.loads((tmp_path / "run.json").read_text())
    assert summary["alive"] == 24
    rows = {row["check"]: row for row in json.loads((tmp_path / "doctor.json").read_text())}
    assert rows["interface"]["ok"]
    assert rows["permission"]["ok"]
    assert rows["nodes"]["found"] == "24 on the bus"
    assert "missing nodes" not in rows


def test_doctor_tells_how_to_bring_an_interface_up(channel):
    ip("link", "set", channel, "down")
    doctor = start("doctor", "--channel", channel)
    out, _ = doctor.communicate(timeout=PATIENCE_S)
    assert doctor.returncode == 1
    assert f"-> ip link set {channel} up" in out


def test_126_patches_on_one_interface(channel, tmp_path):
    arm, scene = many_patches(tmp_path)
    sim = start("sim", scene, "--channel", channel, "--seconds", str(PATIENCE_S))
    run = start("run", arm, "--channel", channel, "--quiet", "--json", str(tmp_path / "run.json"))
    wait_for_patches(channel, 126)
    time.sleep(3.0)
    end(run)
    end(sim)
    summary = json.loads((tmp_path / "run.json").read_text())
    print(summary)
    assert summary["alive"] == 126
    assert summary["frames"]["accepted"] > 504 * 10
