"""The search of `fit` and `full` is compiled by another process, while contacts are of `kmeans`."""

from __future__ import annotations

import subprocess
import sys
import threading
from typing import Final

from skinbus.config.system import load_arm
from skinbus.estimate import LEVELS, Estimator
from skinbus.jit import CompileRefused, on_compile, refuse
from skinbus.jit.kernel_files import kernel_folder
from skinbus.master import Master

ARM: Final = "pad"
"""Kernels are compiled for the kinds of their arguments, which are the same for every arm: the smallest."""
POLL_S: Final = 0.2
"""How often a thread looks whether all is compiled."""
WARM: Final = (sys.executable, "-m", "skinbus", "doctor", "warm")
"""It waits for another of its kind, and then finds everything compiled."""


def is_kept(level: str) -> bool:
    """Load what a level needs; return False where something of it would have to be compiled."""
    try:
        with on_compile(refuse):
            Estimator(load_arm(ARM), level)
    except CompileRefused:
        return False
    return True


class Raising:
    """Has a level compiled that is not, and allows it to a master when it is; this process may end before.

    ``available`` is the level to begin with: ``kmeans``, or the one asked for where it is compiled, or where
    no other process could hand its kernels over.
    """

    def __init__(self, level: str) -> None:
        self.available = level if kernel_folder().path is None or is_kept(level) else LEVELS[0]
        self._level = level
        self._ends = threading.Event()
        self._thread: threading.Thread | None = None
        self._process = (
            subprocess.Popen(
                WARM,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            if self.available != level
            else None
        )

    def start(self, master: Master) -> None:
        """Watch the compiling in a thread, if there is any."""
        if self._process:
            self._thread = threading.Thread(target=self._run, args=(master, self._process), daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Wait no longer; what is being compiled goes on, for the next start."""
        self._ends.set()
        if self._thread:
            self._thread.join()
        if self._process and self._process.poll() is None:
            self._process.returncode = 0  # else Python warns of a process that is forgotten while it runs

    def _run(self, master: Master, process: subprocess.Popen[bytes]) -> None:
        while process.poll() is None:
            if self._ends.wait(POLL_S):
                return
        if is_kept(self._level):  # else it could not be compiled: the master stays below it
            master.allow(self._level)
