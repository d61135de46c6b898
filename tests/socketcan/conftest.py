"""Tests on a real kernel's CAN: they need vcan, and say how to get it where there is none."""

import secrets
import subprocess
import sys
from pathlib import Path

import pytest

from skinbus.master import Master
from skinbus.sim import World, load_scene
from tests.socketcan.can_rig import ip

HERE = Path("/sys/class/net/vcan0").exists()

# Without vcan nothing here is collected; the header says so.
collect_ignore_glob = [] if HERE else ["test_*.py"]


def pytest_report_header():
    return (
        None
        if HERE
        else "tests/socketcan: no vcan0 here; run: tools/socketcan python -m pytest tests/socketcan"
    )


@pytest.fixture(scope="session", autouse=True)
def compiled():
    """All kernels are in numba's cache before anything is timed: compiling takes a minute."""
    scene = load_scene("pad")
    World(scene)
    Master(scene.arm)


@pytest.fixture
def make_channel():
    """Makes new vcan interfaces, up; they are gone after the test."""
    names = []

    def make():
        names.append(f"v{secrets.token_hex(4)}")
        ip("link", "add", names[-1], "type", "vcan")
        ip("link", "set", names[-1], "mtu", "72", "up")
        return names[-1]

    yield make
    for name in names:
        subprocess.run(["ip", "link", "del", name], capture_output=True, check=False)


@pytest.fixture
def channel(make_channel):
    """A new vcan interface, up; gone after the test."""
    return make_channel()


@pytest.fixture
def start():
    """Start a command of ours; none outlives the test."""
    processes = []

    def start(*words):
        command = [sys.executable, "-m", "skinbus", *words]
        processes.append(
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        )
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        print(*process.args, process.returncode, process.communicate()[0])  # if the test fails
