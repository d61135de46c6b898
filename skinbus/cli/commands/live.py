"""`skinbus calibrate live`: presses made on the spot, at places that a dialogue asks for."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import click
import numpy as np

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted
from skinbus.cli.live_presses import talk
from skinbus.cli.options import BusWords, Range, arm_bus_options
from skinbus.cli.output import echo
from skinbus.cli.press_csv import columns_of, read_presses, write_presses
from skinbus.config.arm_file import find_arm, read_arm_file
from skinbus.config.system import load_arm
from skinbus.estimate.calibration.table import Press
from skinbus.master.commissioning.press_guide import PressGuide
from skinbus.model import Arm


@click.command()
@click.argument("arm")
@click.argument("presses", type=click.Path(dir_okay=False, path_type=Path))
@arm_bus_options
@click.option(
    "--weight-n",
    type=Range(min=0.0, min_open=True),
    help="Force of all presses, N. Without it the force is unknown, but must be the same in all.",
)
def command(arm: str, presses: Path, bus: BusWords, weight_n: float | None) -> None:
    """Press the boards of ARM at places that the command asks for; write the presses to PRESSES.

    The command names a press that is wrong, too light or too short, and asks again. It ends when more
    presses would not help. Each press is written at once: after an interruption the same command goes on.
    `skinbus calibrate` and `skinbus calibrate locate` read the file.

    Status 0: enough presses, or `done` was typed. 1: too few. 2: bad file or argument. 3: no bus, or a
    master is active.

    \b
    Examples:
      skinbus calibrate live my-arm.toml presses.csv -c can0 --weight-n 4.905
      skinbus calibrate live my-arm.toml presses.csv -c can0
    """
    whole = load_arm(arm, check_load=False)
    output.keep_files([presses], arm, read_arm_file(find_arm(arm)).files)
    part, place = bus.of(whole)
    force = math.nan if weight_n is None else weight_n
    output.try_to_write(presses)
    kept = made_before(part, presses, force)
    guide, console = PressGuide(part, force, kept), Console()
    if kept:
        console.print(f"{counted(len(kept), 'press')} from before")

    def keep() -> None:
        nonlocal kept
        if len(guide.presses) != len(kept):
            kept = list(guide.presses)
            write_presses(presses, part, kept)

    talk(guide, part, place, console, keep)
    if guide.is_quit or not presses.exists():
        echo("the same command goes on with the presses made so far", err=True)
        sys.exit(1)


def made_before(part: Arm, path: Path, force: float) -> list[Press]:
    """Return the presses of an earlier run; a file of another make, or another force, is refused."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", errors="replace") as file:
        if file.readline().strip() != ",".join(columns_of(part)):
            raise click.BadParameter(f"{path} was not made by `calibrate live`; give a new name")
    presses = read_presses(part, path)
    if any(not np.array_equal(press.force, force, equal_nan=True) for press in presses):
        raise click.BadParameter(f"{path} has presses of another force; give a new name")
    return presses
