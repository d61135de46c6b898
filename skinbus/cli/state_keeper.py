"""Keeps the state of a master and the health of its skin in two files, and takes them up at the start.

The thread of the cycle makes copies, another one writes them.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

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
"""3 million times a year, 20 kB with what the file system adds, are 600 GB in ten years. 8 GB of flash stand
24 TB (3000 cycles), small blocks may be written tenfold: a quarter of its life."""
WRITE_HEALTH_EVERY_S: Final = 600.0
"""50 000 times a year, 50 kB for 24 patches with what the file system adds: 25 GB in ten years. A loss of
power costs ten minutes of what takes weeks to show."""
SUFFIX: Final = ".health"


class Keeper:
    """Keeps a part of a master in a file; ``say`` reports what came of it."""

    name = ""
    copy_s = write_s = 0.0

    def __init__(self, file: StateFile, say: Callable[[str], Any]) -> None:
        self.say = say
        self._file = file
        self._copies: deque[Any] = deque(maxlen=1)
        self._is_faulty = False
        now_s = time.monotonic()
        self._next_copy_s = now_s + self.copy_s
        # the first soon: a master that is killed again and again must not live on a file that grows old
        self._next_write_s = now_s + self.copy_s

    def load(self) -> dict[str, Any] | None:
        """Return the tables of the file, None if none are whole; say what is wrong."""
        tables = self._file.load()
        for fault in self._file.faults:
            self.say(f"{self.name}: {fault}")
        return tables

    def take(self, report: CycleReport) -> None:
        """Take a cycle; called in its thread."""
        if time.monotonic() >= self._next_copy_s:
            self._next_copy_s = time.monotonic() + self.copy_s
            self._copies.append(self.copied())

    def write(self, *, at_end: bool = False) -> None:
        """Write the newest copy if it is time; in another thread. Of several failures the first is said."""
        if not self._copies or not (at_end or time.monotonic() >= self._next_write_s):
            return
        self._next_write_s = time.monotonic() + self.write_s
        try:
            self._file.save(self.tables(self._copies.popleft()))
            self._is_faulty = False
        except OSError as error:
            if not self._is_faulty:
                self.say(f"{self.name}: cannot be written: {error}")
            self._is_faulty = True

    def copied(self) -> Any:
        """Return a copy of what is kept."""
        raise NotImplementedError

    def tables(self, copy: Any) -> dict[str, Any]:
        """Return a copy as tables of a file."""
        raise NotImplementedError


class StateKeeper(Keeper):
    """Zeros, contacts and identities."""

    name = "state"
    copy_s, write_s = COPY_EVERY_S, WRITE_EVERY_S

    def __init__(self, path: Path, memory: Memory, arm: Arm, say: Callable[[str], Any]) -> None:
        super().__init__(StateFile(path), say)
        self._memory, self._arm = memory, arm

    def copied(self) -> Any:
        """Return the state and its moment."""
        return moment(), self._memory.snapshot()

    def tables(self, copy: Any) -> dict[str, Any]:
        """Return them as tables."""
        saved, snapshot = copy
        return {"saved": saved, **self._memory.as_tables(snapshot)}

    def resume(self) -> None:
        """Take up the last state, and say what of it is too old."""
        state = self.load()
        if state is None:
            if self._file.faults:
                self.say("state: none that is whole; zeros are found as at power-on")
            return
        age = age_s(state.get("saved"), moment())
        if age is None:
            self.say("state: its age is not known, the clock was set back; zeros are found as at power-on")
            return
        found = self._memory.resume(state, age)
        self.say(f"state of {age:.0f} s ago: zeros of {counted(found.n_zeros, 'tactel')} taken up")
        for bus, settings in enumerate(self._arm.buses):
            stale = [p for p in found.stale if self._arm.patches[p].bus == bus]
            if stale:
                n = counted(sum(found.stale[p] for p in stale), "tactel")
                where = f"{settings.name} " if len(self._arm.buses) > 1 else ""
                who = nodes(self._arm.node_id[stale].tolist())
                self.say(f"state: too old for {n} of {where}{who}; found as at power-on")
        if found.strangers:
            self.say(f"state: of another board or calibration: {', '.join(found.strangers)}")


class HealthKeeper(Keeper):
    """What changed in each tactel since commissioning."""

    name = "health"
    copy_s = write_s = WRITE_HEALTH_EVERY_S

    def __init__(self, state: Path, health: Health, say: Callable[[str], Any]) -> None:
        super().__init__(health_file(state), say)
        self._health = health

    def copied(self) -> Any:
        """Return the records."""
        return self._health.records.copy()

    def tables(self, copy: Any) -> dict[str, Any]:
        """Return them as tables."""
        return self._health.as_tables(copy)

    def resume(self) -> None:
        """Take up what was seen before."""
        tables = self.load()
        if tables is not None:
            self.say(f"health of {counted(self._health.resume(tables), 'board')} taken up")

    def take(self, report: CycleReport) -> None:
        """Take a cycle; called in its thread."""
        self._health.observe(report)
        super().take(report)

    def write(self, *, at_end: bool = False) -> None:
        """Write the newest copy if it is time, or all there is at the end."""
        if at_end:
            self._copies.append(self.copied())
        super().write(at_end=at_end)


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


def health_file(state: Path) -> StateFile:
    """Return the file of the health that belongs to a state."""
    return StateFile(state.with_name(state.name + SUFFIX))


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
