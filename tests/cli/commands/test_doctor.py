"""Deployment: a valid and tight unit, systemd is notified, the doctor advises."""

import json
import os
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from skinbus.cli.commands.doctor import check_controller, check_interface, unit_text
from skinbus.cli.notify import Notifier
from skinbus.config.arm_file import find_arm
from skinbus.config.arm_tables import ArmTable
from skinbus.config.system import load_arm
from skinbus.skin.addresses import BusAddress
from skinbus.skin.cycle import SkinLayout
from skinbus.skin.shared_memory import SharedWriter, path_of
from tests.cli.invoke import run
from tests.files import put

MAX_EXPOSURE = 25
"""Of systemd-analyze security, in tenths."""


def analyze(tmp_path, unit, *words):
    """Hold a unit against systemd-analyze, where there is one."""
    program, file = tmp_path / "skinbus", tmp_path / "skinbus-master.service"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    file.write_text(unit.replace(str(Path(sys.executable).parent / "skinbus"), str(program)))
    if shutil.which("systemd-analyze"):
        answer = subprocess.run(["systemd-analyze", *words, str(file)], capture_output=True, text=True)
        assert answer.returncode == 0, answer.stdout
        assert words != ("verify",) or not answer.stderr


def test_unit_is_tight(tmp_path):
    analyze(tmp_path, unit_text(), "security", "--offline=true", f"--threshold={MAX_EXPOSURE}", "--no-pager")


def test_slowest_arm_is_not_taken_for_dead():
    """A sign of life goes out with the first cycle after a quarter of the time of the watchdog."""
    (watchdog_s,) = re.findall(r"^WatchdogSec=(\d+)$", unit_text(), re.MULTILINE)
    (slowest_hz,) = [limit.ge for limit in ArmTable.model_fields["rate_hz"].metadata if hasattr(limit, "ge")]
    assert 0.25 * int(watchdog_s) + 1.2 / slowest_hz < int(watchdog_s)


@pytest.mark.parametrize("path", ["", "/nobody/is/here"])
def test_a_manager_that_is_none_or_gone_does_no_harm(path, monkeypatch):
    monkeypatch.setenv("NOTIFY_SOCKET", path)
    notifier = Notifier()
    notifier.alive("")
    notifier.stopping()
    notifier.close()


def test_doctor_says_what_to_do_and_returns_one():
    answer = run("doctor", "forearm", "--channel", "nocan9", status=1)
    assert re.search(r"^fix  interface +nocan9 does not exist.*\n +-> ", answer, re.MULTILINE)
    assert re.search(r"^ok   arm +forearm: 24 patches", answer, re.MULTILINE)


def test_interface_is_what_ip_says_of_it(tmp_path, monkeypatch):
    lo = {"ifname": "lo", "flags": ["LOOPBACK", "UP"], "mtu": 65536, "link_type": "loopback"}
    can = {"ifname": "can0", "flags": ["NOARP", "ECHO"], "mtu": 16, "txqlen": 10, "link_type": "can"}
    put(tmp_path, "ip", f"#!/bin/sh\necho '{json.dumps([lo, can])}'\n").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    found = [
        (one.check, one.found, one.is_wrong)
        for one in check_interface(BusAddress("socketcan", "can0", 500_000))
    ]
    assert found == [("interface", "can0 is down", True), ("send queue", "10 frames", True)]
    (absent,) = check_interface(BusAddress("socketcan", "can1", 500_000))
    assert absent.advice.startswith("CAN interfaces here: can0;")


GOOD = {"bittiming": {"bitrate": 1_000_000}, "state": "ERROR-ACTIVE", "restart_ms": 100}


@pytest.mark.parametrize(
    ("data", "fd", "advised"),
    [
        ({}, None, []),
        ({"bittiming": {}, "bittiming_bitrate": 500_000}, None, ["bit rate"]),
        ({"bittiming": {"bitrate": 500_000}}, None, ["bit rate"]),
        ({"state": "BUS-OFF", "restart_ms": 0}, None, ["controller", "bus-off"]),
        ({"data_bittiming": {"bitrate": 5_000_000}}, 5_000_000, []),
        ({"data_bittiming": {"bitrate": 2_000_000}}, 5_000_000, ["data bit rate"]),
    ],
)
def test_controller_findings_have_advice_where_something_is_wrong(data, fd, advised):
    place = BusAddress("socketcan", "can0", 1_000_000, fd)
    found = [finding for finding in check_controller(place, GOOD | data) if finding.is_wrong]
    assert [finding.check for finding in found] == advised
    assert all(not fd or "dbitrate 5000000 fd on" in finding.advice for finding in found)


def test_unit_runs_the_arm_that_the_doctor_was_given(tmp_path):
    arm = put(tmp_path, "my arm.toml", find_arm("arm-two-buses").read_text())
    answer = run("doctor", arm, "--unit")
    (line,) = [line for line in answer.splitlines() if line.startswith("ExecStart=")]
    assert line.endswith(f' run "{arm}" --quiet --state %S/skinbus/state --share my-arm')
    analyze(tmp_path, unit_text("forearm"), "verify")


def test_no_path_breaks_out_of_its_line_of_the_unit(tmp_path):
    arm = put(tmp_path, "a\nExecStart=evil\t\x1b.toml", find_arm("forearm").read_text())
    lines = unit_text(str(arm)).splitlines()
    assert sum(line.startswith("ExecStart=") for line in lines) == 1
    assert not any(line.startswith("ExecStart=evil") for line in lines)


def test_unit_shares_its_cycles_with_the_group_that_it_names():
    unit = unit_text()
    assert "\nGroup=skinbus\n" in unit
    (umask,) = re.findall(r"^UMask=(\d+)$", unit, re.MULTILINE)
    before = os.umask(int(umask, 8))
    name = f"test-unit-{os.getpid()}"
    try:
        writer = SharedWriter(name, SkinLayout.of(load_arm("forearm")))
        mode = stat.S_IMODE(path_of(name).stat().st_mode)
        writer.close()
    finally:
        os.umask(before)
    assert mode == 0o640
