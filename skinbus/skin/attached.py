"""The skin in shared memory, as another process on this machine writes it; reading disturbs nobody."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.config.system import load_arm
from skinbus.errors import ShareError
from skinbus.estimate import LEVELS
from skinbus.model import Arm
from skinbus.skin.contact import Context
from skinbus.skin.cycle import CONTACT, PATCH, Cycle, CycleFlags, Readings, SkinLayout
from skinbus.skin.feed import Feed, Positions
from skinbus.skin.layout import GEOMETRY
from skinbus.skin.robot_here import RobotHere
from skinbus.skin.shared_memory import BUDGET, HEAD, Offsets, SharedReader, is_written
from skinbus.skin.skin import Skin

LOOKS: Final = 20
"""Looks in a period of one who waits for the next cycle: 1 ms at 50 Hz."""

ATTACH_PAUSE_S: Final = 0.02
"""Between two looks for a writer: a cycle at 50 Hz."""

MARGIN: Final = 2
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
    while not is_written(name) and time.monotonic() < end:
        time.sleep(ATTACH_PAUSE_S)
    return Skin(_SharedFeed(name, loaded))


def unpacked(
    data: bytes, layout: SkinLayout, offsets: Offsets, now_ns: Callable[[], int], robot: RobotHere
) -> Cycle:
    """Return the cycle in the bytes of a slot; pressures were rounded to float32."""
    _, number, t_ns, latency_ns, counter, level, flags, _ = HEAD.unpack_from(data)
    records = np.frombuffer(data, CONTACT, -1, offsets.contacts)
    n = (offsets.faults - offsets.valid) // np.dtype(np.bool_).itemsize
    valid = np.frombuffer(data, np.bool_, n, offsets.valid)
    (budget_us,) = BUDGET.unpack_from(data, offsets.budget)
    return Cycle(
        number,
        t_ns,
        counter,
        LEVELS[level] if level < len(LEVELS) else None,
        CycleFlags(flags),
        1e-9 * latency_ns,
        Context(layout, now_ns, lambda: robot.place(t_ns, records, not valid.any())),
        records,
        np.frombuffer(data, PATCH, len(layout.node_id), offsets.patches),
        Readings(
            np.frombuffer(data, "<f4", n, offsets.pressures).astype(np.float64),
            valid,
            np.frombuffer(data, np.uint8, n, offsets.faults),
        ),
        budget_us=budget_us if budget_us == budget_us else None,
    )


class _SharedFeed(Feed):
    """The cycles of another process; its numbers are those of the writer."""

    def __init__(self, name: str, arm: Arm | None) -> None:
        self._name = name
        self._reader = SharedReader(name)
        layout = self._reader.layout
        super().__init__(layout if arm is None else _on_arm(layout, arm), f"shared memory {name}")
        self._robot = RobotHere(arm)
        self._clock = MonotonicClock()
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
        if not self._is_closed and (newest := self._reader.newest) != self._last.number:
            number, data = self._reader.read_from(newest)
            if number:
                self._last = self._cycle(data)
        return self._last

    def peek(self) -> Cycle:
        """Return the newest cycle."""
        return self.newest()

    def get(self, number: int, timeout_s: float) -> Cycle | None:
        """Return the cycle with a number, or the oldest that is there after it."""
        end = time.monotonic() + timeout_s
        while not self._is_closed:
            found, data = self._reader.read_from(number, MARGIN)
            if found:
                return self._cycle(data)
            if self._reader.is_stopped or time.monotonic() >= end:
                if not self.is_over and not self._reader.is_alive:
                    raise ShareError(f"the process that wrote shared memory {self._name!r} has died")
                return None
            time.sleep(self._pause_s)
        return None

    def set_joints(self, positions: Positions, t_ns: int | None) -> None:
        """Take joint positions of the program."""
        self._robot.offer(self._clock.now_ns() if t_ns is None else t_ns, positions)

    def close(self) -> None:
        """Let go of the memory."""
        if not self._is_closed:
            self._last = self.newest()
            self._is_closed = True
            self._reader.close()

    def _cycle(self, data: bytes) -> Cycle:
        return unpacked(data, self.layout, self._reader.offsets, self._clock.now_ns, self._robot)


def _on_arm(written: SkinLayout, arm: Arm) -> SkinLayout:
    """Return what the writer says of its arm and the arm file of its robot.

    Raises:
        ShareError: they are not of one arm.
    """
    here = SkinLayout.of(arm)
    for what in ("links", "buses", "n_tactels"):
        theirs, ours = getattr(written, what), getattr(here, what)
        if theirs != ours:
            raise ShareError(f"shared memory is of another arm than {arm.name}: {what} {theirs}, not {ours}")
    pairs = zip(GEOMETRY, written.geometry, here.geometry, strict=True)
    if other := [what for what, theirs, ours in pairs if theirs != ours]:
        raise ShareError(
            f"shared memory is of another arm than {arm.name}: not the same {', '.join(other)}; "
            "give the arm file that the writer runs, as it was when it began"
        )
    return replace(written, X_LS=here.X_LS, joints=here.joints)
