"""The skin in shared memory, as another process on this machine writes it; reading disturbs nobody."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from skinbus.config.system import load_arm
from skinbus.errors import ShareError
from skinbus.estimate import LEVELS
from skinbus.model import Arm
from skinbus.skin.contact import Context
from skinbus.skin.cycle import Cycle, CycleFlags, Readings, SkinLayout
from skinbus.skin.feed import Feed
from skinbus.skin.robot_here import RobotHere
from skinbus.skin.shared_memory import SharedReader
from skinbus.skin.skin import Skin

LOOKS = 20
"""Looks in a period of one who waits for the next cycle: 1 ms at 50 Hz."""

ATTACH_PAUSE_S = 0.02
"""Between two looks for a writer: a cycle at 50 Hz."""

MARGIN = 2
"""Slots that are not counted on: the one that is written, and the next."""


def attach(name: str, *, arm: str | Path | Arm | None = None, timeout_s: float = 0.0) -> Skin:
    """Read the cycles that ``skinbus run --share NAME``, or ``skinbus.open(..., share=NAME)``, writes.

    ``latest()`` copies the newest cycle and waits for nothing. When the writer has ended ``is_running`` is
    False at once, the last cycle stays and its age grows; then attach again. What a dead writer
    has left is read too where no other comes within ``timeout_s``; iteration raises ShareError at its end.

    Args:
        name: that the writer was given.
        arm: name or TOML file of the arm, for contacts in the frames of its robot: at the joint positions
            that this program sets, ``skin.joints = q``.
        timeout_s: how long to wait for a writer that runs, s; ``run`` boots the patches first.

    Raises:
        ArgumentError: it is no name.
        ShareError: there is no such shared memory, it is of another version of skinbus or of another arm, or
            its owner is neither this user nor root, and its group is not skinbus.
        ConfigError: the arm file has faults, or its URDF; FileNotFoundError too where there is none.
    """
    loaded = arm if arm is None or isinstance(arm, Arm) else load_arm(arm, check_load=False)
    end = time.monotonic() + timeout_s
    while True:
        is_last = time.monotonic() >= end
        try:
            feed = _SharedFeed(name, loaded)
        except ShareError:
            if is_last:
                raise
        else:
            if feed.is_running or is_last:
                return Skin(feed)
            feed.close()
        time.sleep(ATTACH_PAUSE_S)


class _SharedFeed(Feed):
    """The cycles of another process; its numbers are those of the writer."""

    def __init__(self, name: str, arm: Arm | None) -> None:
        self._name = name
        self._reader = SharedReader(name)
        layout = self._reader.layout
        super().__init__(layout if arm is None else _on_arm(layout, arm), f"shared memory {name}")
        self._here = RobotHere(arm)
        self.robot = self._here.robot
        self._is_closed = False
        self.first = max(self._reader.newest, 1)
        self._pause_s = 1e-9 * self.layout.period_ns / LOOKS

    @property
    def is_over(self) -> bool:
        """Whether the writer was stopped, or this reader."""
        return self._is_closed or self._reader.is_stopped

    @property
    def is_running(self) -> bool:
        """Whether the process that writes is there, and goes on."""
        return not self.is_over and self._reader.is_alive

    def newest(self) -> Cycle:
        """Return the newest cycle."""
        if self._is_closed or (newest := self._reader.newest) == self._last.number:
            return self._last
        if (slot := self._reader.read_from(newest)) is not None:
            self._last = self._cycle(slot)
        return self._last

    def peek(self) -> Cycle:
        """Return the newest cycle."""
        return self.newest()

    def get(self, number: int, timeout_s: float) -> Cycle | None:
        """Return the cycle with a number, or the oldest that is there after it."""
        end = time.monotonic() + timeout_s
        while not self._is_closed:
            if (slot := self._reader.read_from(number, MARGIN)) is not None:
                return self._cycle(slot)
            if self._reader.is_stopped or time.monotonic() >= end:
                if not self.is_over and not self._reader.is_alive:
                    raise ShareError(f"the process that wrote shared memory {self._name!r} has died")
                return None
            time.sleep(self._pause_s)
        return None

    def close(self) -> None:
        """Let go of the memory."""
        if not self._is_closed:
            self._last = self.newest()
            self._is_closed = True
            self._reader.close()

    def _cycle(self, slot: np.void) -> Cycle:
        """Return the cycle in a slot; pressures were rounded to float32."""
        records = slot["contacts"][: slot["n_contacts"]]
        level, budget_us, t_ns = int(slot["level"]), float(slot["budget_us"]), int(slot["t_ns"])
        readings = Readings(slot["pressures"].astype(np.float64), slot["valid"], slot["faults"])
        place = partial(self._here.place, t_ns, records, not readings.valid.any())
        return Cycle(
            int(slot["number"]),
            t_ns,
            int(slot["counter"]),
            LEVELS[level] if level < len(LEVELS) else None,
            CycleFlags(int(slot["flags"])),
            1e-9 * int(slot["latency_ns"]),
            Context(self.layout, self.now_ns, place),
            records,
            slot["patches"],
            readings,
            budget_us=None if math.isnan(budget_us) else budget_us,
        )


def _on_arm(written: SkinLayout, arm: Arm) -> SkinLayout:
    """Return what the arm file of a writer says, whose names are whole, at the rate of the writer.

    Raises:
        ShareError: they are not of one arm.
    """
    here = SkinLayout.of(arm)
    if written.geometry != here.geometry:
        raise ShareError(
            f"shared memory is of another arm than {arm.name}: links or buses have other names, or links, "
            "boards or tactels are elsewhere; give the arm file that the writer runs, as it was when it began"
        )
    return replace(here, period_ns=written.period_ns)
