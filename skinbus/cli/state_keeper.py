"""Keeps the state of a master and the health of its skin in two files, and takes them up at the start.

The thread of the cycle makes copies, another one writes them. How often: see ``WRITE_EVERY_S``.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from skinbus.cli.formatting import counted, nodes
from skinbus.config.state_file import StateFile
from skinbus.errors import ConfigError, Fault
from skinbus.master.cycle import CycleReport
from skinbus.master.health import Health, Records, read_health
from skinbus.master.memory import Memory
from skinbus.model import Arm

COPY_EVERY_S: Final = 1.0
"""A copy takes some ten microseconds of a cycle."""

WRITE_EVERY_S: Final = 10.0
"""So often at most: 3 million times a year, 20 kB with what the file system adds, are 600 GB in ten years.
8 GB of flash stand 24 TB (3000 cycles), small blocks may be written tenfold: a quarter of its life."""

WRITE_ANYWAY_S: Final = 600.0
"""So often at least on an arm that nothing touches: what it reads at a start is its zero."""

MOVED: Final = 0.5
"""Standard deviations of its noise by which a zero has moved when it is written again."""


def moment() -> dict[str, Any]:
    """Return what the age of a state is computed from: by the clock of this boot, and by that on the wall."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        boot = ""
    return {"boot_id": boot, "boot_s": time.clock_gettime(time.CLOCK_BOOTTIME), "unix_s": time.time()}


def age_s(saved: Any, now: dict[str, Any]) -> float | None:
    """Return how old a state is, s; None if no clock gives it.

    Within one boot the clock that nobody sets counts. Over a reboot it is that on the wall; one that stands
    before the time of the state has been set back.
    """
    if not isinstance(saved, dict):
        return None
    key = "boot_s" if now["boot_id"] and saved.get("boot_id") == now["boot_id"] else "unix_s"
    then = saved.get(key)
    age = now[key] - then if isinstance(then, float) else -1.0
    return age if age >= 0.0 else None


class KeptFile:
    """A file of tables; ``say`` reports its faults, each line after ``name``."""

    def __init__(self, file: StateFile, name: str, say: Callable[[str], Any]) -> None:
        self._file = file
        self._name = name
        self._say = say
        self._is_faulty = False

    @property
    def faults(self) -> list[str]:
        """What was wrong when it was loaded."""
        return self._file.faults

    def load(self) -> dict[str, Any] | None:
        """Return the tables, None if none are whole; say what is wrong."""
        tables = self._file.load()
        for fault in self._file.faults:
            self._say(f"{self._name}: {fault}")
        return tables

    def save(self, tables: dict[str, Any]) -> bool:
        """Write tables and return whether they are; the first of several failures is said."""
        try:
            self._file.save(tables)
        except OSError as error:
            if not self._is_faulty:
                self._say(f"{self._name}: cannot be written: {error}")
            self._is_faulty = True
            return False
        self._is_faulty = False
        return True


class StateKeeper:
    """One state file of one master; ``say`` reports what came of it."""

    def __init__(self, path: Path, memory: Memory, arm: Arm, say: Callable[[str], Any]) -> None:
        self._file = KeptFile(StateFile(path), "state", say)
        self._memory = memory
        self._arm = arm
        self._say = say
        self._copies: deque[tuple[dict[str, Any], dict[str, Any]]] = deque(maxlen=1)
        self._next_copy_s = 0.0
        self._written: dict[str, Any] | None = None
        # the first soon: a master that is killed again and again must not live on a state that grows old
        self._written_s = time.monotonic() - WRITE_EVERY_S + COPY_EVERY_S

    def resume(self) -> None:
        """Take up the last state, and say what of it is too old."""
        state = self._file.load()
        if state is None:
            if self._file.faults:
                self._say("state: none that is whole; zeros are found as at power-on")
            return
        age = age_s(state.get("saved"), moment())
        if age is None:
            self._say("state: its age is not known, the clock was set back; zeros are found as at power-on")
            return
        found = self._memory.resume(state, age)
        self._say(f"state of {age:.0f} s ago: zeros of {counted(found.n_zeros, 'tactel')} taken up")
        for bus, settings in enumerate(self._arm.buses):
            stale = [p for p in found.stale if self._arm.patches[p].bus == bus]
            if stale:
                n = sum(found.stale[p] for p in stale)
                where = f"{settings.name} " if len(self._arm.buses) > 1 else ""
                who = nodes(self._arm.node_id[stale].tolist())
                self._say(f"state: too old for {counted(n, 'tactel')} of {where}{who}; found as at power-on")
        if found.strangers:
            self._say(f"state: of another board or calibration: {', '.join(found.strangers)}")

    def copy(self) -> None:
        """Copy the state now and then; called in the thread of the cycle."""
        now_s = time.monotonic()
        if now_s >= self._next_copy_s:
            self._next_copy_s = now_s + COPY_EVERY_S
            self._copies.append((moment(), self._memory.snapshot()))

    def write(self, *, at_end: bool = False) -> None:
        """Write the newest copy if it is time; called in another thread, and at the end."""
        since_s = time.monotonic() - self._written_s
        if not self._copies or (since_s < WRITE_EVERY_S and not at_end):
            return
        saved, snapshot = self._copies[-1]
        if since_s < WRITE_ANYWAY_S and not at_end and not self._differs(snapshot):
            return
        self._copies.clear()
        self._written_s = time.monotonic()
        if self._file.save({"saved": saved, **self._memory.as_tables(snapshot)}):
            self._written = snapshot

    def _differs(self, snapshot: dict[str, Any]) -> bool:
        last = self._written
        if snapshot["tracks"] or snapshot["zeros"].touched.any():
            return True  # what is touched has no zero but that of the state, and an old one is worth nothing
        if last is None or [t.identity for t in last["tracks"]] != [t.identity for t in snapshot["tracks"]]:
            return True
        old, new = last["zeros"], snapshot["zeros"]
        same = np.array_equal(old.zeroed, new.zeroed) and np.array_equal(old.touched, new.touched)
        same = same and np.array_equal(last["faults"], snapshot["faults"])
        return not same or bool((np.abs(new.zero - old.zero) > MOVED * np.sqrt(old.variance)).any())


WRITE_HEALTH_EVERY_S: Final = 600.0
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
        self._next_s = time.monotonic() + WRITE_HEALTH_EVERY_S

    def resume(self) -> None:
        """Take up what was seen before."""
        tables = self._file.load()
        if tables is not None:
            self._say(f"health of {counted(self._health.resume(tables), 'board')} taken up")

    def observe(self, report: CycleReport) -> None:
        """Take a cycle; called in its thread."""
        self._health.observe(report)
        if time.monotonic() >= self._next_s:
            self._copy()

    def write(self, *, at_end: bool = False) -> None:
        """Write what was copied; called in another thread, and at the end."""
        if at_end:
            self._copy()
        if self._copies:
            self._file.save(self._health.as_tables(self._copies.popleft()))

    def _copy(self) -> None:
        self._next_s = time.monotonic() + WRITE_HEALTH_EVERY_S
        self._copies.append(self._health.records.copy())


def load_health(arm: Arm, state: Path) -> list[Records | None]:
    """Return what is known of each patch.

    Raises:
        ConfigError: there is no file, or none that is whole.
    """
    file = health_file(state)
    tables = file.load()
    if tables is None:
        faults = [Fault("file", fault, "a whole one") for fault in file.faults]
        every = round(WRITE_HEALTH_EVERY_S / 60.0)
        wanted = f"a file: `skinbus run --state {state}` writes it every {every} minutes, and when it ends"
        raise ConfigError(str(file.path), faults or [Fault("file", None, wanted)])
    return read_health(arm, tables)
