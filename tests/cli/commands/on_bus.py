"""Cores on a bus of this process, and commands beside them on the same bus."""

import secrets
from contextlib import ExitStack, contextmanager

import pytest

from skinbus.bus.core_thread import CoreThread
from skinbus.bus.pythoncan import PythonCanBus
from tests.cli.invoke import run


class OwnBus:
    """A bus that no other test has."""

    def __init__(self):
        self.channel = f"own-{secrets.token_hex(4)}"

    @contextmanager
    def with_cores(self, *cores):
        """Run cores on it, each in a thread of its own."""
        with ExitStack() as stack:
            for core in cores:
                thread = CoreThread(core, lambda: PythonCanBus("virtual", self.channel))
                thread.start()
                stack.callback(thread.stop)
            yield

    def run(self, *words, **settings):
        """Run a command on it."""
        return run(*words, "--interface", "virtual", "-c", self.channel, **settings)


@pytest.fixture
def own_bus():
    """A bus of this process."""
    return OwnBus()


def passed_rows(output):
    """Return the rows of a check of a board; a busy machine may fail only those about times."""
    slow = {"heartbeat", "readings"}
    rows = [line.split()[:2] for line in output.splitlines()]
    assert {row[1] for row in rows if row[0] == "FAIL"} <= slow, output
    return rows
