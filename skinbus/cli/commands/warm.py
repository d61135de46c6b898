"""`skinbus doctor warm`: compile every kernel that a master needs, before it is needed."""

from __future__ import annotations

import sys

import click

from skinbus.cli.console import Console
from skinbus.cli.host import compiling
from skinbus.cli.output import echo
from skinbus.config.system import load_arm
from skinbus.estimate import LEVELS
from skinbus.jit.kernel_files import kernel_folder
from skinbus.master import Master
from skinbus.skin.compile_ahead import ARM, PARTS, give_way


@click.command()
def command() -> None:
    """Compile all kernels into the cache that `skinbus run` uses. Kernels in it are not compiled again.

    It gives way to everything else on the machine. Status 1 when there is no folder for the cache.

    \b
    Examples:
      skinbus doctor warm
      NUMBA_CACHE_DIR=/var/cache/skinbus skinbus doctor warm
    """
    console = Console()
    give_way()
    with compiling(console, tuple(PARTS)):
        Master(load_arm(ARM), level=LEVELS[-1])
    folder = kernel_folder()
    if folder.path is None:
        echo(f"skinbus: the kernels cannot be kept: {folder.fault}", err=True)
        sys.exit(1)
    echo(f"all kernels are in {folder.path}")
