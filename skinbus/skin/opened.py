"""Be the master of an arm: boots its patches, estimates, publishes, and hands the cycles to the program."""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing
from functools import cache
from pathlib import Path
from subprocess import Popen
from typing import Any

from skinbus.bus.core_thread import CoreThread
from skinbus.can.core import Step
from skinbus.config.system import load_arm
from skinbus.errors import ArgumentError, BusError
from skinbus.estimate import DEFAULT_LEVEL, LEVELS, monotonic_clock
from skinbus.jit import on_compile
from skinbus.master import CycleReport, Master
from skinbus.master.other_master import OtherMaster
from skinbus.model import Arm
from skinbus.skin.addresses import BusAddress, find_places, shown
from skinbus.skin.compile_ahead import allow_when_compiled, first_level, start_compiling
from skinbus.skin.contact import Level
from skinbus.skin.feed import Feed, set_zero
from skinbus.skin.master_cycles import CycleMaker
from skinbus.skin.shared_memory import SharedWriter
from skinbus.skin.skin import Skin

ZERO_S = 2.0
"""A zero is taken at the end of a cycle: longest time that one is waited for."""

Channel = str | Mapping[str, str] | Sequence[str] | None
"""Channels: of one bus, from the names of several, or as words of the command line."""

LOG = logging.getLogger("skinbus")
KERNELS = logging.getLogger("skinbus.kernels")


def open(
    arm: str | Path | Arm,
    *,
    interface: str | None = None,
    channel: Channel = None,
    bitrate: int | None = None,
    level: Level = DEFAULT_LEVEL,
    budget_us: float | None = None,
    zero: bool = False,
    share: str | None = None,
) -> Skin:
    """Be the master of an arm: boot its patches, estimate contacts and publish them, in a thread.

    Args:
        arm: name or TOML file of the arm.
        interface: python-can's name; by default what the arm file says, else "socketcan".
        channel: of the interface, such as "can0"; of several buses a mapping from their names.
        bitrate: bit/s, where the interface sets it.
        level: of the estimator, "kmeans", "fit" or "full".
        budget_us: most time for the estimator in a cycle, us; by default what the cycle leaves.
        zero: take what each patch reads first for its zero: nothing may touch the arm.
        share: name of shared memory that each cycle is written to, for ``skinbus.attach``.

    Raises:
        ConfigError: the arm file has faults; FileNotFoundError too where there is none.
        AddressError: interface or channel fit no bus of the arm.
        ArgumentError: there is no such level.
        BusError: a bus cannot be opened, or another master is at work there.
        ShareError: the name of shared memory is in use.
    """
    check_level(level)
    loaded = arm if isinstance(arm, Arm) else load_arm(arm)
    places = find_places(loaded.buses, interface, channel_words(channel), bitrate)
    return Skin(_MasterFeed(loaded, places, level, share, budget_us=budget_us, zero_at_start=zero))


def check_level(level: str) -> None:
    """Raise ArgumentError when there is no such level of the estimator."""
    if level not in LEVELS:
        raise ArgumentError(f"no level is called {level!r}; there are {', '.join(LEVELS)}")


def channel_words(channel: Channel) -> Sequence[str]:
    """Return channels as the command line has them."""
    if isinstance(channel, Mapping):
        return [f"{name}={value}" for name, value in channel.items()]
    return (channel,) if isinstance(channel, str) else channel or ()


@cache
def _say_why() -> None:
    KERNELS.warning("compiling kernels, once: 10 s, for fit 25 s; `skinbus doctor warm` does it ahead")


def saying_why() -> AbstractContextManager[None]:
    """Return a block in which a log says once why the first start takes long, if kernels are compiled."""
    return on_compile(_say_why)


def make_master(
    arm: Arm,
    places: Sequence[BusAddress],
    level: str,
    meanwhile: AbstractContextManager[None],
    **settings: Any,
) -> tuple[Master, Popen[bytes] | None]:
    """Return a master, and the process that compiles its level if that is not compiled yet.

    The buses are opened first: one that cannot be is an error at once, and other masters are detected.

    Args:
        meanwhile: what says that kernels are compiled.
        settings: of ``Master``.

    Raises:
        BusError: a bus cannot be opened, or another master is at work.
    """
    with ExitStack() as stack:
        buses = [stack.enter_context(closing(place.open())) for place in places]
        available = first_level(level)
        compiler = start_compiling() if available != level else None
        clocks: dict[str, Any] = {"clock": monotonic_clock(), "stopwatch": time.perf_counter_ns}
        with meanwhile:
            master = Master(
                arm, number=secrets.randbits(32), level=level, available=available, **clocks, **settings
            )
        for bus, place in zip(buses, places, strict=True):
            other_master = OtherMaster()
            other_master.step(0, bus.receive(0.0) or bus.receive(2.0 / arm.bus.rate_hz))
            other_master.refuse(str(place))
    return master, compiler


class _MasterFeed(Feed):
    """The cycles of a master that runs in a thread of its own."""

    def __init__(
        self, arm: Arm, places: Sequence[BusAddress], level: str, share: str | None, **settings: Any
    ) -> None:
        self._maker = CycleMaker(arm)
        self._maker.now_ns = self.now_ns
        super().__init__(self._maker.layout, f"master on {shown(places)}")
        self._wanted: deque[tuple[int | None, threading.Event]] = deque()
        self._report: CycleReport | None = None
        self._master, compiler = make_master(
            arm, places, level, saying_why(), on_cycle=self._on_cycle, **settings
        )
        self.robot = self._master.robot
        with ExitStack() as undo:
            self._writer = undo.enter_context(closing(SharedWriter(share, self.layout))) if share else None
            self._thread = CoreThread(
                self._master,
                *(place.open for place in places),
                on_step=self._on_step,
                on_end=lambda error: self.end(error or self._master.gave_way),
                complain=LOG.info,
                urgent=True,
            )
            undo.pop_all()
        self._thread.start()
        if compiler:
            allow_when_compiled(self._master, level, compiler)

    def zero(self, patch: int | None) -> None:
        """Take new zeros at the end of the next cycle."""
        taken = threading.Event()
        self._wanted.append((patch, taken))
        if not taken.wait(ZERO_S):
            raise BusError(f"no cycle within {ZERO_S:g} s: zeros were not taken")

    def close(self) -> None:
        """Take contacts back, stop the patches, and end the thread."""
        self._thread.stop()
        if self._writer:
            self._writer.close()

    def _on_cycle(self, report: CycleReport) -> None:
        while self._wanted:
            patch, taken = self._wanted.popleft()
            set_zero(self._master, patch)
            taken.set()
        self._report = report

    def _on_step(self, _step: Step) -> None:
        """Hand a cycle over when its frames are out: the program, once woken, competes with this thread."""
        if self._report is None:
            return
        cycle = self._maker.make(self._master, self._report)
        self._report = None
        if self._writer:
            self._writer.write(cycle)
        self.push(cycle)
