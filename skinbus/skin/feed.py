"""Where the cycles of a skin come from: pushed by a thread, or made when they are asked for."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy.typing as npt

from skinbus.errors import LocalProtocolError
from skinbus.master import Master
from skinbus.skin.contact import NO_ROBOT
from skinbus.skin.cycle import Cycle, SkinLayout, no_cycle

if TYPE_CHECKING:
    from skinbus.master.robot import MasterRobot

Positions = npt.ArrayLike | Mapping[str, float]
"""Of joints: a number for each that is set from Python, or some by name."""

KEPT = 256
"""Cycles that a consumer may be behind before it loses some: 5 s at 50 Hz."""

LATE_S = 0.1
"""A simulation or recording that is so late does not catch up: its time goes on from there."""

PACE_S = 1.0
"""Over which its pace is measured."""


class Feed:
    """Cycles pushed by a thread, numbered from 1 on; consumers follow the last ``KEPT`` side by side."""

    is_pulled = False
    """Whether a cycle is made when it is asked for: then time stands still between two of them."""

    first = 1
    """Number of the cycle that a new consumer begins with."""

    pace = 1.0
    """Seconds of the source in one of real time; below 1 the machine is too slow for it."""

    robot: MasterRobot | None = None
    """What takes joint positions."""

    def __init__(self, layout: SkinLayout, what: str) -> None:
        """``what`` the cycles come from, for people."""
        self.layout = layout
        self.what = what
        self._last = no_cycle(layout)
        self._kept: deque[Cycle] = deque(maxlen=KEPT)
        self._came = threading.Condition()
        self._is_over = False
        self._error: BaseException | None = None

    def now_ns(self) -> int:
        """Time on the clock of the source (ns): the machine's monotonic clock."""
        return time.monotonic_ns()

    @property
    def is_over(self) -> bool:
        """Whether no more cycles will come."""
        return self._is_over

    @property
    def is_running(self) -> bool:
        """Whether cycles may come: the source has not ended, nor has the process that it depends on."""
        return not self.is_over

    def push(self, cycle: Cycle) -> None:
        """Add a cycle; its number is that of the one before and 1."""
        with self._came:
            self._kept.append(cycle)
            self._last = cycle
            self._came.notify_all()

    def end(self, error: BaseException | None = None) -> None:
        """Say that no more cycles will come, and why."""
        with self._came:
            self._is_over, self._error = True, error
            self._came.notify_all()

    def peek(self) -> Cycle:
        """Return the newest cycle there is; makes none, and raises nothing."""
        return self._last

    def newest(self) -> Cycle:
        """Return the newest cycle; never waits. Raises what has ended the source, if that is an error."""
        if self._error is not None:
            raise self._error
        return self._last

    def get(self, number: int, timeout_s: float) -> Cycle | None:
        """Return the first cycle still kept whose number is at least this; None if none came in time.

        Raises what has ended the source, if that is an error and no cycle is left.
        """
        with self._came:
            self._came.wait_for(lambda: self._last.number >= number or self._is_over, timeout_s)
            if self._last.number >= number:
                return self._kept[max(number - self._kept[0].number, 0)]
        if self._error is not None:
            raise self._error
        return None

    def zero(self, patch: int | None) -> None:
        """Make what a patch reads now its zero; all patches when None."""
        raise LocalProtocolError("only the process of the master, or a client on its bus, can set zeros")

    def set_joints(self, t_ns: int, positions: Positions) -> None:
        """Take joint positions of a time on the clock of the source."""
        if self.robot is None:
            raise LocalProtocolError(NO_ROBOT)
        self.robot.offer(t_ns, positions)

    def close(self) -> None:
        """End the source, cleanly; a second call does nothing."""


class MadeFeed(Feed):
    """Cycles of a master without time of its own, made one by one when a consumer asks for one."""

    is_pulled = True

    def __init__(self, layout: SkinLayout, what: str, cycles: Iterator[Cycle], master: Master) -> None:
        super().__init__(layout, what)
        self._cycles = cycles
        self._master, self.robot = master, master.robot
        self._lock = threading.Lock()

    def now_ns(self) -> int:
        """Time of the source (ns): the end of its last cycle."""
        return self._last.ended_ns

    def newest(self) -> Cycle:
        """Make the next cycle, and return it; the last one at the end."""
        return self.get(self._last.number + 1, 0.0) or self._last

    def get(self, number: int, timeout_s: float) -> Cycle | None:
        """Return the cycle with a number, making it if need be."""
        with self._lock:
            while self._last.number < number and not self._is_over:
                cycle = next(self._cycles, None)
                if cycle is None:
                    self.end()
                else:
                    self._last = cycle
            return self._last if self._last.number >= number else None

    def zero(self, patch: int | None) -> None:
        """Take new zeros."""
        with self._lock:
            set_zero(self._master, patch)

    def close(self) -> None:
        """Make no more cycles."""
        self.end()


class PacedFeed(MadeFeed):
    """The same, each cycle made and pushed by a thread when its time has come on the machine's clock."""

    is_pulled = False
    newest, get = Feed.newest, Feed.get

    def __init__(self, layout: SkinLayout, what: str, cycles: Iterator[Cycle], master: Master) -> None:
        super().__init__(layout, what, cycles, master)
        self._offset_ns = -time.monotonic_ns()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="skinbus", daemon=True)

    def start(self) -> None:
        """Let time begin."""
        self._thread.start()

    def now_ns(self) -> int:
        """Time of the source (ns), which goes on with the machine's clock."""
        return time.monotonic_ns() + self._offset_ns

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    def _next(self) -> Cycle | None:
        with self._lock:
            return next(self._cycles, None)

    def _run(self) -> None:
        """Hand the cycles on; where the machine is too slow, time goes slower, and the newest is of now."""
        error: BaseException | None = None
        begun_s, begun_ns = time.monotonic(), 0
        try:
            while cycle := self._next():
                ended_ns, is_first = cycle.ended_ns, cycle.number == 1
                wait_s = 1e-9 * (ended_ns - self.now_ns())
                if is_first:
                    begun_s, begun_ns = time.monotonic(), ended_ns
                if is_first or wait_s < -LATE_S:
                    self._offset_ns, wait_s = ended_ns - time.monotonic_ns(), 0.0
                if self._stop.wait(max(wait_s, 0.0)):
                    break
                self.push(cycle)
                if (elapsed_s := time.monotonic() - begun_s) > PACE_S:
                    self.pace = 1e-9 * (ended_ns - begun_ns) / elapsed_s
                    begun_s, begun_ns = time.monotonic(), ended_ns
        except BaseException as caught:  # noqa: BLE001 - raised where cycles are taken
            error = caught
        self.end(error)


def set_zero(master: Master, patch: int | None) -> None:
    """Take what a patch of a master reads now as its zero; that of all when None."""
    if patch is None:
        master.branches[0].network.zero(0)
    else:
        arm = master.arm
        master.branches[int(arm.patch_bus[patch])].network.zero(int(arm.node_id[patch]))
