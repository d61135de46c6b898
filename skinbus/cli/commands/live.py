"""`skinbus calibrate live`: presses made on the spot, at places that a dialogue asks for."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import click

from skinbus.cli import output
from skinbus.cli.live_presses import press_live
from skinbus.cli.options import BusWords, Range, arm_bus_options
from skinbus.cli.output import echo
from skinbus.config.arm_file import find_arm, read_arm_file
from skinbus.config.system import load_arm
from skinbus.model import Arm


@click.command()
@click.argument("arm")
@click.argument("presses", type=click.Path(dir_okay=False, path_type=Path))
@arm_bus_options
@click.option(
    "--weight-n",
    type=Range(min=0.0, min_open=True),
    help="The same force in all presses, N. Without it forces are not known, but the same.",
)
@click.option("--node", "node_ids", type=int, multiple=True, help="Press this board only; repeatable.")
def command(
    arm: str, presses: Path, bus: BusWords, weight_n: float | None, node_ids: tuple[int, ...]
) -> None:
    """Press the boards of ARM now, at the places that are asked for, and keep the presses in PRESSES.

    A press that is wrong, too light or too short is named and asked for again. It ends when more presses
    would not help. Each press is in the file as soon as it is made: after an interruption the same command
    goes on. `skinbus calibrate` and `skinbus calibrate locate` read the file.

    Status 0: enough presses, or `done` was typed. 1: not so. 2: bad file or argument. 3: no bus, or a master
    is active.

    \b
    Examples:
      skinbus calibrate live my-arm.toml presses.csv -c can0 --weight-n 4.905
      skinbus calibrate live my-arm.toml presses.csv -c can0 --node 5
    """
    whole = load_arm(arm, check_load=False)
    output.keep_files([presses], arm, read_arm_file(find_arm(arm)).files)
    part, place = bus.of(whole)
    patches = [placed for placed in part.patches if not node_ids or placed.node_id in node_ids]
    if len(patches) < len(node_ids):
        raise click.BadParameter(f"not all are node-IDs of {part.name}: {node_ids}", param_hint="--node")
    force = math.nan if weight_n is None else weight_n
    boards = Arm(part.name, part.links, patches, *part.buses)
    if not (press_live(boards, place, presses, force) and presses.exists()):
        echo("the same command goes on with the presses made so far", err=True)
        sys.exit(1)
