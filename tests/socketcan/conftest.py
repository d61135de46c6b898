"""Tests on a real kernel's CAN: they need vcan, and say how to get it where there is none."""

import secrets
import subprocess
from pathlib import Path

import pytest
from can_rig import ip

from skinbus.master import Master
from skinbus.sim import World, load_scene

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
def channel():
    """A new vcan interface, up; gone after the test."""
    name = f"v{secrets.token_hex(4)}"
    ip("link", "add", name, "type", "vcan")
    ip("link", "set", name, "mtu", "72", "up")
    yield name
    subprocess.run(["ip", "link", "del", name], capture_output=True, check=False)
