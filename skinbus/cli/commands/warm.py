"""`skinbus doctor warm`: compile every kernel that a master needs, before it is needed."""

from __future__ import annotations

import fcntl
import os
import socket
import sys
from contextlib import nullcontext

import click

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.bus.socketcan_batch import BatchReader, finish_kernel
from skinbus.cli.console import Console
from skinbus.cli.host import compiling
from skinbus.cli.output import echo
from skinbus.estimate import LEVELS
from skinbus.jit.kernel_files import kernel_folder
from skinbus.skin.compile_ahead import ARM
from skinbus.skin.simulated import simulate


@click.command()
def command() -> None:
    """Compile all kernels into the cache that `skinbus run` uses. Kernels in it are not compiled again.

    It gives way to everything else on the machine. Status 1 when there is no folder for the cache.

    \b
    Examples:
      skinbus doctor warm
      NUMBA_CACHE_DIR=/var/cache/skinbus skinbus doctor warm
    """
    # who starts this may have the priority of a master
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    os.nice(10)
    folder = kernel_folder()
    with (
        (folder.path / "warm.lock").open("a") if folder.path else nullcontext() as lock,
        compiling(Console()),
    ):
        if lock:  # everything is compiled once, however many ask for it
            fcntl.flock(lock, fcntl.LOCK_EX)
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            BatchReader(sock, MonotonicClock(), 1, finish_kernel())
        for level in reversed(LEVELS):  # who started this may compile `kmeans` meanwhile
            with simulate(ARM, level=level) as skin:  # the smallest arm: kernels are the same for all
                next(skin)
    if folder.path is None:
        echo(f"skinbus: the kernels cannot be kept: {folder.fault}", err=True)
        sys.exit(1)
    echo(f"all kernels are in {folder.path}")
