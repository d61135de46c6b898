"""`skinbus calibrate locate`: the place and yaw of each board from presses at known places."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.table import Table

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted
from skinbus.cli.options import Range, bus_option, file_option, json_option
from skinbus.cli.output import JsonFile
from skinbus.cli.press_csv import read_presses
from skinbus.config.arm_edit import write_arm
from skinbus.config.arm_file import find_arm, read_arm_file
from skinbus.config.placement import Mounting
from skinbus.config.system import load_arm
from skinbus.estimate.location import OUTLIER, PLACE_SD, Located, Location, PlacedPress, locate
from skinbus.estimate.presses.kinds import Press
from skinbus.model import Arm

WORDS = {"s": "the place along s", "a": "the place across", "yaw": "the yaw"}
MOST_LINES = 10
WORST = 1.5e-3
"""m, by which presses may scatter: those by hand do by 1 mm. Twice what is said of them, if that is more."""
MAX_SHIFT = 15e-3
"""m, by which a board may lie off its place in the file: five times what hands mount boards off by, and less
than a third of a board of 50 mm, so that it is nearer to its own place than to that of a neighbour."""


@click.command()
@click.argument("arm")
@click.option(
    "--presses",
    type=output.Readable(path_type=Path),
    required=True,
    help="A CSV file as that of `skinbus calibrate`.",
)
@click.option(
    "--place-sd-mm",
    type=Range(min=0.01, max=10.0),
    default=1e3 * PLACE_SD,
    show_default=True,
    help="Standard deviation of s_mm and a_mm of the presses; their residuals refine it.",
)
@click.option("--write", is_flag=True, help="Write places and yaws into the arm file; its comments stay.")
@file_option("--out", help="Write them into this file, in place of ARM.")
@bus_option
@json_option
def command(
    arm: str,
    presses: Path,
    place_sd_mm: float,
    write: bool,
    out: Path | None,
    bus: str | None,
    json_file: JsonFile | None,
) -> None:
    """Find where the boards of ARM sit, from presses at known places of their links.

    The places are those of a robot's tool, or of a probe in a jig; what a board reads says where on it the
    press was. Six presses a board near its corners, at 0.3 mm, give 0.2 mm and 0.4 degrees. Presses that fit
    no place of their board are named and left out; what presses do not determine stays as it is.

    Nothing is written without --write or --out. Status 1: a board is turned otherwise than the file says
    (`skinbus scan identify` finds how) or mirrored, lies over 15 mm off, as at the place of another, or its
    presses fit no place, as in other units; it stays where it is. 2: bad file or argument.

    \b
    Examples:
      skinbus calibrate locate my-arm.toml --presses presses.csv
      skinbus calibrate locate my-arm.toml --presses presses.csv --write
    """
    path = find_arm(arm)
    loaded = load_arm(arm, check_load=False)
    target = out or (path if write else None)
    if write and out is None and str(path) != arm:
        raise click.UsageError(f"{arm} ships with skinbus and is not written; say where to by --out")
    if target is not None:
        if any(placed.on_chart is not None for placed in loaded.patches):
            raise click.UsageError(f"{arm} has boards on meshes: their places are changed by hand, in xyz_mm")
        output.try_to_write(target)
        output.keep_files([target], arm, read_arm_file(path).files[1:])  # the first is the arm file
    rows = read_presses(loaded, presses, bus).presses
    found = locate(
        loaded,
        [PlacedPress(row.patch, row.s, row.a, row.readings) for row in rows],
        place_sd=1e-3 * place_sd_mm,
    )
    console = Console()
    console.print(table_of(loaded, found))
    worst = max(WORST, 2e-3 * place_sd_mm)
    faults = [fault_of(loaded, board, found.place_sd, worst) for board in found.boards]
    for board, fault in zip(found.boards, faults, strict=True):
        for text in remarks(loaded, board, fault, rows):
            console.print(text, style="yellow", soft_wrap=True)
    console.print(f"presses scatter by {1e3 * found.place_sd:.2f} mm along each direction")
    if json_file:
        json_file.write(summary_of(loaded, found, faults, rows))
    if target is not None:
        mountings = read_arm_file(path).mountings
        changes = changes_of(loaded, mountings, found, faults)
        write_arm(path, target, changes)
        console.print(f"{target}: {counted(len(changes), 'board')} moved", soft_wrap=True)
    sys.exit(1 if any(faults) else 0)


def table_of(arm: Arm, found: Location) -> Table:
    """Return the boards as a table."""
    table = Table()
    for name in ("node", "along s", "across", "yaw", "presses"):
        table.add_column(name, justify="right")
    for board in found.boards:
        sd = np.sqrt(np.diag(board.covariance))
        dx, dy, turn = board.shift
        table.add_row(
            arm.node_label(board.patch),
            f"{1e3 * dx:+.2f} ± {1e3 * sd[0]:.2f} mm",
            f"{1e3 * dy:+.2f} ± {1e3 * sd[1]:.2f} mm",
            f"{math.degrees(turn):+.2f} ± {math.degrees(sd[2]):.2f} deg",
            f"{len(board.used)} of {len(board.used) + len(board.outliers) + len(board.unusable)}",
        )
    return table


def fault_of(arm: Arm, board: Located, scatter: float, worst: float) -> str:
    """Return why a board is not moved; nothing if it is. Presses scatter by ``scatter`` m."""
    if not board.used:
        return "none of its presses can be used"
    if scatter > worst:
        return (
            f"presses scatter by {1e3 * scatter:.1f} mm, more than {1e3 * worst:.1f} mm: are s_mm and a_mm "
            "those of these presses, in this order, in millimetres?"
        )
    if 2 * len(board.outliers) >= len(board.used) and not board.is_mirrored:
        return (
            "its presses fit no place: are they of this board, s_mm and a_mm in this order, in millimetres?"
        )
    if board.is_mirrored:
        return "its presses fit the mirrored board: say so in the arm file (mirrored), or by `scan identify`"
    if board.is_turned:
        turn = math.degrees(board.shift[2])
        return (
            f"it is turned by {turn:.0f} deg: say so in the arm file (yaw_deg), or by skinbus scan identify"
        )
    if (shift := math.hypot(*board.shift[:2])) > MAX_SHIFT:
        return (
            f"its presses fit {1e3 * shift:.0f} mm from its place, more than boards are mounted off "
            f"({1e3 * MAX_SHIFT:.0f} mm): {_there(arm, board)}"
        )
    return ""


def _there(arm: Arm, board: Located) -> str:
    """Return what a board far from its place may be: the one whose place that is, or a wrong file."""
    link = arm.patches[board.patch].link
    others = [p for p, placed in enumerate(arm.patches) if placed.link == link and p != board.patch]
    if others:
        off = arm.links[link].surface.distance(board.s, board.a, arm.patch_s[others], arm.patch_a[others])
        if off.min() <= MAX_SHIFT:
            other = arm.node_label(others[int(off.argmin())])
            return (
                f"it is the place of node {other}; are their node-IDs swapped? `skinbus scan identify` finds "
                "the board that is pressed"
            )
    return "correct s_mm, angle_deg or a_mm in the arm file first, or node_id in the presses"


def remarks(arm: Arm, board: Located, fault: str, rows: Sequence[Press]) -> Iterator[str]:
    """Return what is to be said of a board beside its place."""
    node = f"node {arm.node_label(board.patch)}"
    if fault:
        yield f"{node}: {fault}"
    for words, numbers in (
        (f"more than {OUTLIER:g} standard deviations off, left out", board.outliers),
        ("no single contact on the board, left out", board.unusable),
    ):
        if numbers:
            lines = ", ".join(str(rows[k].line) for k in numbers[:MOST_LINES])
            more = f" and {len(numbers) - MOST_LINES} more" if len(numbers) > MOST_LINES else ""
            yield f"{node}: line {lines}{more}: {words}"
    if board.unknown and not fault:
        what = " and ".join(WORDS[name] for name in board.unknown)
        yield f"{node}: its presses do not determine {what}; spread them over the board"


def changes_of(
    arm: Arm, mountings: Sequence[Mounting], found: Location, faults: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Return what is to change in the tables of the arm file, by key."""
    changes = {}
    for board, fault in zip(found.boards, faults, strict=True):
        if fault:
            continue
        surface = arm.links[arm.patches[board.patch].link].surface
        change: dict[str, Any] = {"s_mm": round(1e3 * board.s, 3)}
        if surface.period:
            change["angle_deg"] = round(math.degrees(board.a / surface.radius), 3)
        else:
            change["a_mm"] = round(1e3 * board.a, 3)
        if "yaw" not in board.unknown:
            change["yaw_deg"] = round(math.degrees(board.yaw), 3)
        changes[mountings[board.patch].key] = change
    return changes


def summary_of(arm: Arm, found: Location, faults: Sequence[str], rows: Sequence[Press]) -> dict[str, Any]:
    """Return the result for a program."""
    boards = [
        {
            "node_id": int(arm.node_id[board.patch]),
            "bus": arm.buses[arm.patches[board.patch].bus].name,
            "s_mm": 1e3 * board.s,
            "a_mm": 1e3 * board.a,
            "yaw_deg": math.degrees(board.yaw),
            "covariance": board.covariance.tolist(),
            "used": [rows[k].line for k in board.used],
            "outliers": [rows[k].line for k in board.outliers],
            "unusable": [rows[k].line for k in board.unusable],
            "unknown": list(board.unknown),
            "fault": fault,
        }
        for board, fault in zip(found.boards, faults, strict=True)
    ]
    return {"place_sd_mm": 1e3 * found.place_sd, "boards": boards}
