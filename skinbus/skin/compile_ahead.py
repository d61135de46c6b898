"""Kernels that are not kept yet are compiled by processes of their own, the cheapest level first.

A program publishes contacts at level ``kmeans`` as soon as what that needs is compiled; the levels above
follow while it runs. Where kernels cannot be kept, a process could not hand them over: then each program
compiles its own.
"""

from __future__ import annotations

import fcntl
import gc
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from functools import cache
from typing import Any, Final

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.fd_bits import frame_ns
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.config.system import load_arm
from skinbus.estimate import LEVELS, Baseline, Estimator, Tracker
from skinbus.estimate.plausibility import Plausibility
from skinbus.jit import CompileRefused, on_compile, refuse
from skinbus.jit.kernel_files import kernel_folder
from skinbus.master import Master
from skinbus.model import Arm
from skinbus.objects import cia

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
PLAIN: Final = {"NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING": "1"}
"""numba colours thousands of errors that are no errors: templates that do not fit the types of a call."""
GC_THRESHOLDS: Final = (50_000, 20, 50)
"""Kernels are graphs of objects that live until they are compiled: looking for garbage as often as Python
does takes a tenth of the time; this seldom, it takes no more memory."""


@cache
def _arm() -> Arm:
    """Return the arm of all parts: a start that has everything compiled loads each of them."""
    return load_arm(ARM)


def _cycle() -> None:
    """Run what is small: zeros, what is not plausible, and what reads a SocketCAN interface."""
    Baseline(_arm())
    Plausibility(_arm())
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
    "cycle": _cycle,
    "patches": _patches,
    "fit": lambda: Estimator(_arm(), "fit"),
    "full": lambda: Estimator(_arm(), "full"),
}
"""What compiles each part, or loads it; the first three are what any master needs, the longest first."""
BASE: Final = ("kmeans", "tracking", "cycle")
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


def start(part: str) -> subprocess.Popen[bytes]:
    """Compile a part in a process that goes on to its end; what another compiles already is waited for."""
    return subprocess.Popen(
        (sys.executable, "-c", PROGRAM, part),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,  # else who reads ours would wait for its end
        start_new_session=True,
        env=os.environ | PLAIN,
    )


def compiled(parts: Iterable[str], is_asked_to_end: Callable[[], bool]) -> Iterator[str]:
    """Yield each part when it has been compiled, until the caller is asked to end.

    Levels are compiled in order, as each has the kernels of those below it, and the others beside them.
    """
    queues: tuple[list[str], list[str]] = [], []
    for part in parts:
        queues[part in LEVELS].append(part)
    running: dict[int, tuple[str, subprocess.Popen[bytes]]] = {}
    while not is_asked_to_end():
        for k, queue in enumerate(queues):
            if k in running and running[k][1].poll() is None:
                continue
            if k in running:
                yield running.pop(k)[0]
            if queue:
                running[k] = queue[0], start(queue.pop(0))
        if not running:
            return
        time.sleep(POLL_S)


def compile_missing(
    parts: Iterable[str],
    on_begin: Callable[[int], Callable[[], Any]],
    is_asked_to_end: Callable[[], bool] = lambda: False,
) -> None:
    """Compile those of some parts that are not kept; return when they are, or could not be.

    on_begin: called with their number before the first, if there are any; returns what is called after each.
    """
    missing = [] if kernel_folder().path is None else [part for part in parts if not is_kept(part)]
    on_part = on_begin(len(missing)) if missing else None
    for _ in compiled(missing, is_asked_to_end):
        if on_part:
            on_part()


def first_level(level: str) -> str:
    """Return a level if its kernel is kept or none can be, else ``kmeans``."""
    return level if kernel_folder().path is None or is_kept(level) else LEVELS[0]


class Raising:
    """Has the levels above that of a master compiled, and allows each as soon as it is."""

    def __init__(self, master: Master, available: str, level: str) -> None:
        self._master = master
        self._todo = LEVELS[LEVELS.index(available) + 1 : LEVELS.index(level) + 1]
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name="skinbus-compile", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Wait no longer; what is being compiled goes on, for the next start."""
        self._ends.set()
        self._thread.join()

    def _run(self) -> None:
        for level in compiled(self._todo, self._ends.is_set):
            if is_kept(level):  # else it could not be compiled: the master stays below it
                self._master.allow(level)


def give_way() -> None:
    """Take no time from a master: who starts this process may have the priority of one."""
    if hasattr(os, "SCHED_BATCH"):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def main() -> None:
    """Compile a part, giving way to everything else on the machine; of each only one process at a time."""
    give_way()
    os.nice(10)
    gc.set_threshold(*GC_THRESHOLDS)
    folder, part = kernel_folder().path, sys.argv[1]
    with (folder / f"{part}.lock").open("a") if folder else nullcontext() as lock:
        if lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
        PARTS[part]()
