"""The search of `fit` and `full` is compiled by another process, while contacts are of `kmeans`."""

from __future__ import annotations

import subprocess
import sys
import threading

from skinbus.config.system import load_arm
from skinbus.estimate import LEVELS, Estimator
from skinbus.jit import CompileRefused, on_compile, refuse
from skinbus.jit.kernel_files import kernel_folder
from skinbus.master import Master

ARM = "pad"
"""Kernels are compiled for the kinds of their arguments, which are the same for every arm: the smallest."""
WARM = (sys.executable, "-m", "skinbus", "doctor", "warm")
"""It waits for another of its kind, and then finds everything compiled."""


def is_kept(level: str) -> bool:
    """Load what a level needs; return False where something of it would have to be compiled."""
    try:
        with on_compile(refuse):
            Estimator(load_arm(ARM), level)
    except CompileRefused:
        return False
    return True


def first_level(level: str) -> str:
    """Return a level where it is compiled, or no process could hand its kernels over; else ``kmeans``."""
    return level if kernel_folder().path is None or is_kept(level) else LEVELS[0]


def start_compiling() -> subprocess.Popen[bytes]:
    """Have all levels compiled by a process that outlives this one."""
    return subprocess.Popen(
        WARM,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def allow_when_compiled(master: Master, level: str, process: subprocess.Popen[bytes]) -> None:
    """Allow a level to a master when the process that compiles it has ended."""

    def wait() -> None:
        process.wait()
        if is_kept(level):  # else it could not be compiled: the master stays below it
            master.allow(level)

    threading.Thread(target=wait, name="skinbus-compile", daemon=True).start()
