"""Keeps what a master has learned in a file while it runs, and takes it up at the start.

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
from skinbus.cli.kept_file import KeptFile
from skinbus.config.state_file import StateFile
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
