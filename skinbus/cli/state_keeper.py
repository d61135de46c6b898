"""Keeps the state of a master and the health of its skin in two files, and takes them up at the start.

The thread of the cycle makes copies, another one writes them.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from skinbus.config.state_file import StateFile
from skinbus.errors import ConfigError, Fault
from skinbus.formatting import counted
from skinbus.master.cycle import CycleReport
from skinbus.master.health import Health, Records, read_health
from skinbus.master.memory import Memory
from skinbus.model import Arm

COPY_EVERY_S = 1.0
"""A copy takes some ten microseconds of a cycle."""
WRITE_EVERY_S = 10.0
"""3 million times a year, 20 kB with what the file system adds, are 600 GB in ten years. 8 GB of flash stand
24 TB (3000 cycles), small blocks may be written tenfold: a quarter of its life."""
WRITE_HEALTH_EVERY_S = 600.0
"""50 000 times a year, 50 kB for 24 patches with what the file system adds: 25 GB in ten years. A loss of
power costs ten minutes of what takes weeks to show."""
SUFFIX = ".health"


class Keeper:
    """Keeps a part of a master in a file; ``say`` reports what came of it."""

    def __init__(
        self, name: str, file: StateFile, part: Memory | Health, say: Callable[[str], Any], every_s: float
    ) -> None:
        """A file is written ``every_s``, and at the end."""
        self._name, self._say, self._file, self._part, self._every_s = name, say, file, part, every_s
        self._copies: deque[tuple[float, Any]] = deque(maxlen=1)
        self._is_faulty = False
        self._next_copy_s = time.monotonic() + COPY_EVERY_S
        # the first soon: a master that is killed again and again must not live on a file that grows old
        self._next_write_s = self._next_copy_s

    def load(self) -> dict[str, Any] | None:
        """Return the tables of the file, None if none are whole; say what is wrong."""
        tables = self._file.load()
        for fault in self._file.faults:
            self._say(f"{self._name}: {fault}")
        if tables is None and self._file.faults:
            self._say(f"{self._name}: none that is whole; it begins as at power-on")
        return tables

    def take(self, report: CycleReport) -> None:
        """Take a cycle; called in its thread."""
        if isinstance(self._part, Health):
            self._part.observe(report)
        if time.monotonic() >= self._next_copy_s:
            self._next_copy_s = time.monotonic() + COPY_EVERY_S
            self._copies.append((time.time(), self._part.snapshot()))

    def write(self, *, at_end: bool = False) -> None:
        """Write the newest copy if it is time; in another thread. Of several failures the first is said."""
        if not self._copies or not (at_end or time.monotonic() >= self._next_write_s):
            return
        self._next_write_s = time.monotonic() + self._every_s
        saved, copy = self._copies.popleft()
        was_faulty, self._is_faulty = self._is_faulty, False
        try:
            self._file.save({"saved": saved, **self._part.as_tables(copy)})
        except OSError as error:
            self._is_faulty = True
            if not was_faulty:
                self._say(f"{self._name}: cannot be written: {error}")


def keep_state(path: Path, memory: Memory, arm: Arm, say: Callable[[str], Any]) -> Keeper:
    """Take up the last zeros and contacts, say what of them is too old, and keep them from now on."""
    keeper = Keeper("state", StateFile(path), memory, say, WRITE_EVERY_S)
    state = keeper.load()
    if state is None:
        return keeper
    saved = state.get("saved")
    age = time.time() - saved if isinstance(saved, float) else -1.0
    if age < 0.0:
        say("state: its age is not known, the clock was set back; zeros are found as at power-on")
        return keeper
    found = memory.resume(state, age)
    say(f"state of {age:.0f} s ago: zeros of {counted(found.n_zeros, 'tactel')} taken up")
    if found.stale:
        boards = ", ".join(map(arm.node_label, found.stale))
        n = counted(sum(found.stale.values()), "tactel")
        say(f"state: too old for {n} of node {boards}; found as at power-on")
    if found.strangers:
        say(f"state: of another board or calibration: {', '.join(found.strangers)}")
    return keeper


def keep_health(state: Path, health: Health, say: Callable[[str], Any]) -> Keeper:
    """Take up what was seen of each tactel since commissioning, and keep it from now on."""
    keeper = Keeper("health", health_file(state), health, say, WRITE_HEALTH_EVERY_S)
    tables = keeper.load()
    if tables is not None:
        say(f"health of {counted(health.resume(tables), 'board')} taken up")
    return keeper


def health_file(state: Path) -> StateFile:
    """Return the file of the health that belongs to a state."""
    return StateFile(state.with_name(state.name + SUFFIX))


def load_health(arm: Arm, state: Path) -> list[Records | None]:
    """Return what is known of each patch.

    Raises:
        ConfigError: there is no file, or none that is whole.
    """
    file = health_file(state)
    if (tables := file.load()) is not None:
        return read_health(arm, tables)
    every = round(WRITE_HEALTH_EVERY_S / 60.0)
    wanted = f"a file: `skinbus run --state {state}` writes it every {every} minutes, and when it ends"
    faults = [Fault("file", fault, "a whole one") for fault in file.faults]
    raise ConfigError(file.path, faults or [Fault("file", None, wanted)])
