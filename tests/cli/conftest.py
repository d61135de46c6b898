"""Commands as processes, and a bus that crosses processes on any machine."""

import subprocess
import sys

import pytest

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
