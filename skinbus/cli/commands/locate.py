"""`skinbus calibrate locate`: the place and yaw of each board from presses at known places."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from skinbus.cli.arm_target import arm_target
from skinbus.cli.console import Console
from skinbus.cli.options import INPUT, file_option
from skinbus.cli.press_csv import read_presses
from skinbus.config.arm_edit import write_arm
from skinbus.config.arm_file import find_arm
from skinbus.config.placement import keys_of
from skinbus.config.system import load_arm
from skinbus.estimate.calibration.location import OUTLIER, Located, locate
from skinbus.estimate.calibration.table import Press
from skinbus.formatting import counted, span
from skinbus.model import Arm

TITLES = ("node", "along s", "across", "yaw", "presses")
WORDS = {"s": "the place along s", "a": "the place across", "yaw": "the yaw"}
WORST = 1.5e-3
"""m, by which presses may scatter: those by hand do by 1 mm."""
MAX_SHIFT = 15e-3
"""m, by which a board may lie off its place in the file: five times what hands mount boards off by, and less
than a third of a board of 50 mm, so that it is nearer to its own place than to that of a neighbour."""


@click.command()
@click.argument("arm")
@click.argument("presses", type=INPUT)
@click.option("--write", is_flag=True, help="Write places and yaws into the arm file; its comments stay.")
@file_option("--out", help="Write them into this file, in place of ARM.")
def command(arm: str, presses: Path, write: bool, out: Path | None) -> None:
    """Find where the boards of ARM sit, from presses at known places of their links.

    PRESSES is a CSV file as `skinbus calibrate` reads it. Its places come from a robot's tool, or from a
    probe in a jig. The readings of a board say where on the board the press was. Six presses near the
    corners of a board, known to 0.3 mm, give its place to 0.2 mm and 0.4 degrees. Presses that fit no place
    of their board are named and left out. A place or yaw that the presses do not determine is not changed.

    Nothing is written without --write or --out. Status 1: a board is turned or mirrored unlike the file
    says, lies more than 15 mm off its place, or its presses fit no place. Such a board is not moved, and the
    likely cause is named. 2: bad file or argument.

    \b
    Examples:
      skinbus calibrate locate my-arm.toml presses.csv
      skinbus calibrate locate my-arm.toml presses.csv --write
    """
    path, loaded = find_arm(arm), load_arm(arm, check_load=False)
    target = arm_target(arm, path, loaded, out) if write or out else None
    rows = read_presses(loaded, presses)
    found = locate(loaded, rows)
    console = Console()
    console.table(TITLES, [row_of(loaded, board) for board in found.boards])
    changes, is_faulty = {}, False
    for board in found.boards:
        fault = fault_of(board, found.place_sd)
        is_faulty |= bool(fault)
        for text in remarks(board, fault, rows):
            console.print(f"node {loaded.node_label(board.patch)}: {text}", style="yellow")
        if not fault:
            changes[loaded.patches[board.patch].key] = place_of(loaded, board)
    console.print(f"presses scatter by {1e3 * found.place_sd:.2f} mm along each direction")
    if target is not None:
        write_arm(path, target, changes)
        console.print(f"{target}: {counted(len(changes), 'board')} moved")
    sys.exit(1 if is_faulty else 0)


def row_of(arm: Arm, board: Located) -> tuple[str, ...]:
    """Return the row of a board in the table."""
    scale = np.array([1e3, 1e3, math.degrees(1.0)])
    columns = scale * board.shift, scale * np.sqrt(np.diag(board.covariance)), ("mm", "mm", "deg")
    cells = [f"{step:+.2f} ± {sd:.2f} {unit}" for step, sd, unit in zip(*columns, strict=True)]
    n_made = len(board.used) + len(board.outliers) + len(board.unusable)
    return arm.node_label(board.patch), *cells, f"{len(board.used)} of {n_made}"


def fault_of(board: Located, scatter: float) -> str:
    """Return why a board is not moved; nothing if it is. Presses scatter by ``scatter`` m."""
    right = "are s_mm and a_mm those of these presses, of this board, in this order, in millimetres?"
    if not board.used:
        return "none of its presses can be used"
    if scatter > WORST:
        return f"presses scatter by {1e3 * scatter:.1f} mm, more than {1e3 * WORST:.1f} mm: {right}"
    if board.is_mirrored:
        return "its presses fit the mirrored board: say so in the arm file (mirrored)"
    if 2 * len(board.outliers) >= len(board.used):
        return f"its presses fit no place: {right}"
    if board.is_turned:
        turn = math.degrees(board.shift[2])
        return f"it is turned by {turn:.0f} deg: say so in the arm file (yaw_deg)"
    if (shift := math.hypot(*board.shift[:2])) > MAX_SHIFT:
        fits = f"its presses fit {1e3 * shift:.0f} mm from its place, more than boards are mounted off"
        return f"{fits}: correct its place in the arm file, or node_id in the presses (see `scan identify`)"
    return ""


def remarks(board: Located, fault: str, rows: Sequence[Press]) -> Iterator[str]:
    """Return what is to be said of a board beside its place."""
    unknown = " and ".join(WORDS[name] for name in board.unknown)
    if fault or unknown:
        yield fault or f"its presses do not determine {unknown}; spread them over the board"
    for words, numbers in (
        (f"more than {OUTLIER:g} standard deviations off, left out", board.outliers),
        ("no single contact on the board, left out", board.unusable),
    ):
        if numbers:
            yield f"line {span(rows[k].line for k in numbers)}: {words}"


def place_of(arm: Arm, board: Located) -> dict[str, Any]:
    """Return the place of a board as an arm file has it."""
    surface = arm.links[arm.patches[board.patch].link].surface
    place = keys_of(surface, board.s, board.a)
    if "yaw" not in board.unknown:
        place["yaw_deg"] = math.degrees(board.yaw)
    return {key: round(value, 3) for key, value in place.items()}
