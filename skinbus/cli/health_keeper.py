"""Keeps the health of a skin in a file while its master runs: beside the state, written far more rarely."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from skinbus.cli.formatting import counted
from skinbus.cli.kept_file import KeptFile
from skinbus.config.state_file import StateFile
from skinbus.errors import ConfigError, Fault
from skinbus.master.cycle_report import CycleReport
from skinbus.master.health import Health, Records, read_health
from skinbus.model import Arm

WRITE_EVERY_S: Final = 600.0
"""50 000 times a year, 50 kB for 24 patches with what the file system adds: 25 GB in ten years. A loss of
power costs ten minutes of what takes weeks to show."""

SUFFIX: Final = ".health"


def health_file(state: Path) -> StateFile:
    """Return the file of the health that belongs to a state."""
    return StateFile(state.with_name(state.name + SUFFIX))


class HealthKeeper:
    """The health of one master; ``say`` reports what came of its file."""

    def __init__(self, state: Path, health: Health, say: Callable[[str], Any]) -> None:
        self._file = KeptFile(health_file(state), "health", say)
        self._health = health
        self._say = say
        self._copies: deque[Records] = deque(maxlen=1)
        self._next_s = time.monotonic() + WRITE_EVERY_S

    def resume(self) -> None:
        """Take up what was seen before."""
        tables = self._file.load()
        if tables is not None:
            self._say(f"health of {counted(self._health.resume(tables), 'board')} taken up")

    def observe(self, report: CycleReport) -> None:
        """Take a cycle; called in its thread."""
        self._health.observe(report)
        if time.monotonic() >= self._next_s:
            self.copy()

    def copy(self) -> None:
        """Copy what is known, to be written."""
        self._next_s = time.monotonic() + WRITE_EVERY_S
        self._copies.append(self._health.records.copy())

    def write(self) -> None:
        """Write the newest copy, if there is one; called in another thread, and at the end after ``copy``."""
        if self._copies:
            self._file.save(self._health.as_tables(self._copies.popleft()))


def load_health(arm: Arm, state: Path) -> list[Records | None]:
    """Return what is known of each patch.

    Raises:
        ConfigError: there is no file, or none that is whole.
    """
    file = health_file(state)
    tables = file.load()
    if tables is None:
        faults = [Fault("file", fault, "a whole one") for fault in file.faults]
        every = round(WRITE_EVERY_S / 60.0)
        wanted = f"a file: `skinbus run --state {state}` writes it every {every} minutes, and when it ends"
        raise ConfigError(str(file.path), faults or [Fault("file", None, wanted)])
    return read_health(arm, tables)
