"""The skin in shared memory, as another process on this machine writes it; reading disturbs nobody."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Final

import numpy as np

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.can.clock import Clock
from skinbus.config.system import load_arm
from skinbus.errors import ShareError
from skinbus.estimate import LEVELS
from skinbus.master.level_control import CycleFlags
from skinbus.model import Arm
from skinbus.skin.cycle import CONTACT, PATCH, Cycle, Now, Readings, Records, SkinLayout, no_cycle
from skinbus.skin.feed import Feed, Positions
from skinbus.skin.layout import GEOMETRY
from skinbus.skin.robot_here import ReadCycle, offer_joints, robot_here
from skinbus.skin.shared_memory import BUDGET, HEAD, SLOTS, Offsets, SharedReader, is_written
from skinbus.skin.skin import Skin

LOOKS: Final = 20
"""Looks in a period of one who waits for the next cycle: 1 ms at 50 Hz."""

ATTACH_PAUSE_S: Final = 0.02
"""Between two looks for a writer: a cycle at 50 Hz."""

MARGIN: Final = 2
"""Slots that are not counted on: the one that is written, and the next."""


def attach(name: str, *, arm: str | Path | Arm | None = None, timeout_s: float = 0.0) -> Skin:
    """Read the cycles that ``skinbus run --share NAME``, or ``skinbus.open(..., share=NAME)``, writes.

    arm:       name or TOML file of the arm, for contacts in the frames of its robot: at the joint positions
               that this program sets, ``skin.joints = q``
    timeout_s: how long to wait for a writer that runs; ``run`` boots the patches first

    ``latest()`` copies the newest cycle and waits for nothing. When the writer has ended ``is_running`` is
    False at once, the last cycle stays and its age grows; then attach again. What a dead writer
    has left is read too where no other comes within ``timeout_s``; iteration raises ShareError at its end.

    Raises:
        ShareError: there is no such shared memory, or it is of another version of skinbus, or of another arm.
        ConfigError: the arm file has faults, or its URDF.
    """
    loaded = arm if arm is None or isinstance(arm, Arm) else load_arm(arm, check_load=False)
    end = time.monotonic() + timeout_s
    while not is_written(name) and time.monotonic() < end:
        time.sleep(ATTACH_PAUSE_S)
    return Skin(_SharedFeed(name, loaded))


class SharedCycle(ReadCycle):
    """A cycle out of the bytes of a slot; without a clock its ages are as of its end."""

    def __init__(self, data: bytes, layout: SkinLayout, offsets: Offsets, clock: Clock | None) -> None:
        # A controller waits for these lines; what it does not ask for is not made.
        self._head = HEAD.unpack_from(data)
        self.number, self.t_ns = self._head[1:3]
        self.layout = layout
        self._clock = clock
        self._data = data
        self._offsets = offsets

    @property
    def counter(self) -> int:  # type: ignore[override]
        """Of the SYNC, 1..240."""
        return int(self._head[4])

    @cached_property
    def level(self) -> str | None:  # type: ignore[override]
        """The most accurate level that it used."""
        return LEVELS[self._head[5]] if self._head[5] < len(LEVELS) else None

    @cached_property
    def flags(self) -> CycleFlags:  # type: ignore[override]
        """What was not as it should be."""
        return CycleFlags(self._head[6])

    @cached_property
    def latency_s(self) -> float:  # type: ignore[override]
        """From its SYNC until its contacts were out, s."""
        return 1e-9 * float(self._head[3])

    @cached_property
    def now(self) -> Now:  # type: ignore[override]
        """What ages count from."""
        return Now(self._clock, self.t_ns + self._head[3])

    @cached_property
    def budget_us(self) -> float | None:  # type: ignore[override]
        """Most time that the estimator had; None where it is not known."""
        (budget_us,) = BUDGET.unpack_from(self._data, self._offsets.budget)
        return budget_us if budget_us == budget_us else None

    @property
    def records(self) -> Records:
        """The contacts as records."""
        return np.frombuffer(self._data, CONTACT, -1, self._offsets.contacts)

    def _rows(self) -> tuple[bytes, int]:
        return self._data, self._offsets.contacts

    def _later_records(self) -> Callable[[], Records]:
        return partial(np.frombuffer, self._data, CONTACT, -1, self._offsets.contacts)

    @property
    def patch_records(self) -> Records:
        """The patches as records."""
        return np.frombuffer(self._data, PATCH, len(self.layout.node_id), self._offsets.patches)

    @property
    def is_blind(self) -> bool:  # type: ignore[override]
        """Whether nothing was read."""
        offsets = self._offsets
        return True not in memoryview(self._data)[offsets.valid : offsets.faults].cast("?")

    @cached_property
    def readings(self) -> Readings:
        """The readings; pressures were rounded to float32."""
        n, offsets = self.layout.n_tactels, self._offsets
        return Readings(
            np.frombuffer(self._data, "<f4", n, offsets.pressures).astype(np.float64),
            np.frombuffer(self._data, np.bool_, n, offsets.valid),
            np.frombuffer(self._data, np.uint8, n, offsets.faults),
        )


class _SharedFeed(Feed):
    """The cycles of another process; its numbers are those of the writer."""

    def __init__(self, name: str, arm: Arm | None) -> None:
        self._name = name
        self._reader = SharedReader(name)
        layout = self._reader.layout
        if arm is not None:
            layout = _on_arm(layout, arm)
        super().__init__(layout)
        self._robot = robot_here(arm)
        self._clock = MonotonicClock()
        self._last = no_cycle(self.layout)
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
        """Return the newest cycle.

        One that is known is read anew and dropped: at 1 kHz that keeps in the caches what one call in twenty
        needs, which else takes twice as long after 20 ms without use, and a controller plans for the longest.
        """
        if not self._is_closed:
            number, data = self._reader.read_newest()
            cycle = self._cycle(data) if number else self._last
            if number != self._last.number:
                self._last = cycle
        return self._last

    def _cycle(self, data: bytes) -> SharedCycle:
        cycle = SharedCycle(data, self.layout, self._reader.offsets, self._clock)
        if self._robot:
            cycle.place_later_on(self._robot)
        return cycle

    def set_joints(self, positions: Positions, t_ns: int | None) -> None:
        """Take joint positions of the program."""
        offer_joints(self._robot, self._clock.now_ns() if t_ns is None else t_ns, positions)

    def peek(self) -> Cycle:
        """Return the newest cycle."""
        return self.newest()

    def get(self, number: int, timeout_s: float) -> Cycle | None:
        """Return the cycle with a number, or the oldest that is there after it."""
        end = time.monotonic() + timeout_s
        while not self._is_closed:
            newest = self._reader.newest
            if newest >= number:
                oldest = max(number, newest - SLOTS + 1 + MARGIN)
                if (data := self._reader.read(oldest)) is not None:
                    return self._cycle(data)
            elif self._reader.is_stopped or time.monotonic() >= end:
                if not self.is_over and not self._reader.is_alive:
                    raise ShareError(f"the process that wrote shared memory {self._name!r} has died")
                return None
            else:
                time.sleep(self._pause_s)
        return None

    def close(self) -> None:
        """Let go of the memory."""
        if not self._is_closed:
            self._last = self.newest()
            self._is_closed = True
            self._reader.close()


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
