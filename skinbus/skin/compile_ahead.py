"""Kernels that are not kept yet are compiled by processes of their own, the cheapest level first.

A program publishes contacts at level ``kmeans`` as soon as what that needs is compiled; the levels above
follow while it runs. Where kernels cannot be kept, a process could not hand them over: then each program
compiles its own.
"""

from __future__ import annotations

import gc
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing, suppress
from functools import cache
from typing import Any, Final

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.fd_bits import frame_ns
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.system import load_arm, ods_of
from skinbus.estimate import LEVELS, Baseline, Estimator, Tracker
from skinbus.estimate.plausibility import Plausibility
from skinbus.jit import CompileRefused, on_compile, refuse
from skinbus.jit.kernel_files import kernel_folder
from skinbus.master import Master
from skinbus.master.freshness import Freshness
from skinbus.master.gather import Gather
from skinbus.model import Arm
from skinbus.objects import cia
from skinbus.objects.readings import ReadingsPlan

ARM: Final = "pad"
"""Kernels are compiled for the kinds of their arguments, which are the same for every arm: the smallest."""
BOOTED_NS: Final = 100_000_000
"""Simulated patches have sent their boot-up by then."""
START_ALL: Final = bytes((1, 0))
"""NMT start of all nodes (CiA 301, 7.2.8.3.1)."""
POLL_S: Final = 0.05
"""How often it is asked what has been compiled: each part takes several seconds."""
PROGRAM: Final = "from skinbus.skin.compile_ahead import main; main()"
"""Started with ``-m``, compiling takes a quarter more of the processor, all of it in the kernel."""
DONE: Final = b"\x06"
"""ASCII acknowledge: numba prints none, whatever its settings for debugging are."""
PLAIN: Final = {"NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING": "1"}
"""numba colours thousands of errors that are no errors: templates that do not fit the types of a call."""
GC_THRESHOLDS: Final = (50_000, 20, 50)
"""Kernels are graphs of objects that live until they are compiled: looking for garbage as often as Python
does takes a tenth of the time; this seldom, it takes no more memory."""


@cache
def _arm() -> Arm:
    """Return the arm of all parts: a start that has everything compiled loads each of them."""
    return load_arm(ARM)


def _zeros() -> None:
    arm = _arm()
    Baseline(arm)
    Plausibility(arm)


def _readings() -> None:
    """Run what is small: readings, and what reads a SocketCAN interface."""
    arm = _arm()
    plan = ReadingsPlan(arm, ods_of(arm))
    Gather(plan, arm.n_tactels, Freshness(plan, 1))
    if sys.platform == "linux":
        from skinbus.bus.socketcan_batch import BatchReader

        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            BatchReader(sock, MonotonicClock(), 1)


class _Starter(Core):
    """Starts patches and asks them for readings once."""

    def step(self, now_ns: int, frames: Sequence[Frame]) -> Step:
        if now_ns < BOOTED_NS:
            return Step((), (), BOOTED_NS)
        return Step((Frame(cia.NMT_COMMAND_ID, START_ALL), Frame(cia.SYNC_ID)), (), NEVER)


def _patches() -> None:
    """Run what simulated patches need: one cycle of a scene, on the smallest arm."""
    from skinbus.sim import World, load_scene

    scene = load_scene(ARM)
    wire = VirtualBus(scene.arm.bus.bitrate)
    wire.attach(World(scene))
    wire.attach(_Starter())
    wire.tap(lambda frame: frame_ns(frame, scene.arm.bus.bitrate, None))
    wire.run(2 * BOOTED_NS)


PARTS: Final[dict[str, Callable[[], object]]] = {
    "kmeans": lambda: Estimator(_arm(), "kmeans"),
    "tracking": lambda: Tracker(_arm()),
    "zeros": _zeros,
    "readings": _readings,
    "patches": _patches,
    "fit": lambda: Estimator(_arm(), "fit"),
    "full": lambda: Estimator(_arm(), "full"),
}
"""What compiles each part, or loads it; the first four are what any master needs, the longest first."""
BASE: Final = ("kmeans", "tracking", "zeros", "readings")
SIMULATED: Final = (*BASE, "patches")
"""Of a master beside simulated patches."""


def parts_of(level: str, base: tuple[str, ...] = BASE) -> tuple[str, ...]:
    """Return the parts that a master of a level needs."""
    return (*base, *LEVELS[1 : LEVELS.index(level) + 1])


def is_kept(part: str) -> bool:
    """Load a part; return False where something of it would have to be compiled."""
    try:
        with on_compile(refuse):
            PARTS[part]()
    except CompileRefused:
        return False
    return True


class Compilation:
    """Parts that are compiled in processes of their own: levels in their order by one, the others by another.

    Each level contains kernels of those below it, which a process compiles once.
    Closing ends the processes; kernels that are compiled by then are kept.
    """

    def __init__(self, parts: Iterable[str], at_once: int | None = None) -> None:
        parts = list(parts)
        levels = [part for part in parts if part in LEVELS]
        others = [part for part in parts if part not in LEVELS]
        self._waiting = [each for each in (levels, others) if each]
        self._at_once = at_once or os.cpu_count() or 1
        self._running: dict[subprocess.Popen[bytes], list[str]] = {}

    def poll(self) -> list[str]:
        """Start what there is a core for; return the parts that have ended since the last call."""
        ended = []
        for process, parts in list(self._running.items()):
            assert process.stdout is not None
            is_over = process.poll() is not None
            n = len(parts) if is_over else (process.stdout.read() or b"").count(DONE)
            ended += parts[:n]
            del parts[:n]
            if is_over:
                del self._running[process]
                with process:  # closes its pipes
                    pass
        while self._waiting and len(self._running) < self._at_once:
            parts = self._waiting.pop(0)
            command = sys.executable, "-c", PROGRAM, *parts
            process = subprocess.Popen(  # its standard input is open while we live
                command, bufsize=0, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=os.environ | PLAIN
            )
            assert process.stdout is not None
            os.set_blocking(process.stdout.fileno(), False)
            self._running[process] = parts
        return ended

    @property
    def is_over(self) -> bool:
        """Whether nothing runs or waits."""
        return not self._waiting and not self._running

    def close(self) -> None:
        """End the processes."""
        self._waiting.clear()
        for process in self._running:
            with process:  # closes its pipes
                process.terminate()
        self._running.clear()


def compile_missing(
    parts: Iterable[str],
    on_begin: Callable[[int], Callable[[], Any]],
    is_asked_to_end: Callable[[], bool] = lambda: False,
) -> None:
    """Compile those of some parts that are not kept; return when they are, or could not be.

    on_begin: called with their number before the first, if there are any; returns what is called after each.
    """
    missing = [] if kernel_folder().path is None else [part for part in parts if not is_kept(part)]
    if not missing:
        return
    on_part = on_begin(len(missing))
    with closing(Compilation(missing)) as compilation:
        while not (compilation.is_over or is_asked_to_end()):
            for _ in compilation.poll():
                on_part()
            time.sleep(POLL_S)


def first_level(level: str) -> str:
    """Return a level if its kernel is kept or none can be, else ``kmeans``."""
    return level if kernel_folder().path is None or is_kept(level) else LEVELS[0]


class Raising:
    """Compiles the levels above that of a master, and allows each as soon as it is compiled, until closed."""

    def __init__(self, master: Master, available: str, level: str) -> None:
        self._master = master
        self._todo = LEVELS[LEVELS.index(available) + 1 : LEVELS.index(level) + 1]
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name="skinbus-compile", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End what is being compiled."""
        self._ends.set()
        self._thread.join()

    def _run(self) -> None:
        with closing(Compilation(self._todo, at_once=1)) as compilation:  # another core is the master's
            while not (compilation.is_over or self._ends.wait(POLL_S)):
                for level in compilation.poll():
                    if is_kept(level):  # else it could not be compiled: the master stays below it
                        self._master.allow(level)


def give_way() -> None:
    """Take no time from a master: who starts this process may have the priority of one."""
    if hasattr(os, "SCHED_BATCH"):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def _end_with_parent() -> None:
    """End this process where standard input has: its writer may be killed and started again many times.

    Asked between kernels.
    """
    with suppress(BlockingIOError):
        if not os.read(0, 1):
            os._exit(1)


def main() -> None:
    """Compile parts, giving way to everything else on the machine, while who asked for them lives.

    ``DONE`` on standard output says that one is compiled.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C is for all processes of a terminal
    os.set_blocking(0, False)
    give_way()
    os.nice(10)
    gc.set_threshold(*GC_THRESHOLDS)
    with on_compile(_end_with_parent):
        for part in sys.argv[1:]:
            PARTS[part]()
            os.write(1, DONE)
