"""Commands as processes, and a bus that crosses processes on any machine."""

import subprocess
import sys

import pytest

from tests.cli.commands.on_bus import own_bus  # noqa: F401 (a fixture)
from tests.cli.commands.recordings import record_pad
from tests.own_bus import own_group


@pytest.fixture
def group():
    """A multicast group that no other test run on this machine uses."""
    return own_group()


@pytest.fixture
def skinbus():
    """Starts `skinbus ARGS` as a process; whatever still runs at the end is stopped as Ctrl-C would."""
    processes = []

    def start(*args: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "skinbus", *args],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.terminate()
        process.communicate()


@pytest.fixture(scope="session")
def field(tmp_path_factory):
    """A recording of the scene pad: do not change it."""
    path = tmp_path_factory.mktemp("field") / "field.log"
    record_pad(path)
    return path
