"""`skinbus warm`: compile every kernel that a master needs, before it is needed."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Callable

import click

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.cli.console import Console
from skinbus.cli.host import compiling
from skinbus.cli.output import echo
from skinbus.cli.progress import progress
from skinbus.config.system import load_arm
from skinbus.estimate import LEVELS, Estimator
from skinbus.jit.kernel_files import kernel_folder
from skinbus.master import Master

ARM = "forearm"
"""Kernels are compiled for the kinds of their arguments, which are the same for every arm."""


@click.command()
def command() -> None:
    """Compile all kernels to where `skinbus run` will look for them; nothing is done where they are there.

    It gives way to everything else on the machine. Status 1 when they cannot be kept.

    \b
    Examples:
      skinbus warm
      NUMBA_CACHE_DIR=/var/cache/skinbus skinbus warm
    """
    console = Console()
    if hasattr(os, "SCHED_BATCH"):  # a service runs this with the priority of its master
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    arm = load_arm(ARM)
    steps: list[Callable[[], object]] = [
        *(lambda level=level: Estimator(arm, level) for level in LEVELS),
        lambda: Master(arm, level=LEVELS[-1]),
        _load_reader,
    ]
    with compiling(console), progress(console, "kernels", len(steps)) as advance:
        for step in steps:
            step()
            advance(1)
    folder = kernel_folder()
    if folder.path is None:
        echo(f"skinbus: the kernels cannot be kept: {folder.fault}", err=True)
        sys.exit(1)
    echo(f"all kernels are in {folder.path}")


def _load_reader() -> None:
    """Load what reads a SocketCAN interface, where there is such a thing."""
    if sys.platform == "linux":
        from skinbus.bus.socketcan_batch import BatchReader

        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            BatchReader(sock, MonotonicClock(), 1)
