"""`skinbus doctor health`: what changed in each tactel since commissioning, and what to replace."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.table import Table

from skinbus.cli.console import Console
from skinbus.cli.formatting import nodes, span
from skinbus.cli.options import file_option, json_option
from skinbus.cli.output import JsonFile
from skinbus.cli.state_keeper import load_health
from skinbus.config.system import load_arm
from skinbus.master.health import NAMES, SAMPLE_NS, SETTLED, Records, findings, slopes
from skinbus.model import Arm

STATE = Path("/var/lib/skinbus/state")
"""Of the service."""


@click.command()
@click.argument("arm")
@file_option(
    "--state",
    default=STATE,
    show_default=True,
    help="The state that `skinbus run --state` keeps; the health is beside it.",
)
@click.option("--tactels", is_flag=True, help="List all tactels, not only boards.")
@json_option
def command(arm: str, state: Path, tactels: bool, json_file: JsonFile | None) -> None:
    """Show how the tactels of ARM have changed since they were commissioned, and what to do.

    The master keeps it while it runs with --state: noise, zero, its slope on that of the board (temperature
    moves the zeros of a board together: 1 is as the others), touches and faults.
    The state that a board is compared with is that at its commissioning: when the master first read its
    serial number and calibration.

    Status 0: nothing to do, or not commissioned yet. 1: findings. 2: no such arm, or no health.

    \b
    Examples:
      skinbus doctor health my-arm.toml --state my-arm.state
      skinbus doctor health my-arm.toml --tactels
    """
    loaded = load_arm(arm)
    boards = load_health(loaded, state)
    console = Console()
    console.print(table_of(loaded, boards, each=tactels))
    found = findings(loaded, boards)
    for finding in found:
        which = f" tactel{'s' if len(finding.tactels) > 1 else ''} {span(finding.tactels)}"
        where = f"node {loaded.node_label(finding.patch)}{which if finding.tactels else ''}"
        console.print(f"{where}: {finding.what}\n  -> {finding.advice}", style="yellow", soft_wrap=True)
    if waiting := not_commissioned(loaded, boards):
        console.print(waiting, soft_wrap=True)
    elif not found:
        console.print("nothing to do")
    if json_file:
        json_file.write(summary_of(loaded, boards))
    sys.exit(1 if found else 0)


def not_commissioned(arm: Arm, boards: list[Records | None]) -> str:
    """Return which boards have nothing yet to be compared with, and for how long; nothing if all have."""
    new = {
        p: int(board["samples"].max())
        for p, board in enumerate(boards)
        if board is not None and not np.isfinite(board["noise_first"]).any()
    }
    if not new:
        return ""
    minutes = math.ceil(max(SETTLED - min(new.values()), 1) * SAMPLE_NS / 60e9)
    return (
        f"{_nodes(arm, new)}: not commissioned yet, so nothing is "
        f"compared; {minutes} min to go while the master runs and nothing touches them"
    )


def table_of(arm: Arm, boards: list[Records | None], *, each: bool) -> Table:
    """Return boards, or each of their tactels, as a table; of boards medians, and sums of counts."""
    table = Table()
    for name in ("node", "noise, Pa", "was", "zero, Pa", "was", "slope", "touches", "faults"):
        table.add_column(name, justify="right")
    for p, board in enumerate(boards):
        node = arm.node_label(p)
        if board is None:
            table.add_row(node, "not seen")
            continue
        first = [board[name] for name in ("noise", "noise_first", "zero", "zero_first")]
        columns = (*first, slopes(board))
        counts = (board["touches"], board["faults"])
        if not each:
            middle = [
                _shown(_median(column), digits) for column, digits in zip(columns, _DIGITS, strict=True)
            ]
            table.add_row(node, *middle, *(f"{column.sum():.0f}" for column in counts))
            continue
        for k in range(len(board)):
            row = [_shown(float(column[k]), digits) for column, digits in zip(columns, _DIGITS, strict=True)]
            table.add_row(f"{node}.{k + 1}", *row, *(f"{column[k]:.0f}" for column in counts))
    return table


_DIGITS = (0, 0, 0, 0, 2)


def _median(column: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    known = column[np.isfinite(column)]
    return float(np.median(known)) if len(known) else math.nan


def _shown(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def summary_of(arm: Arm, boards: list[Records | None]) -> dict[str, Any]:
    """Return all columns and findings for a program."""
    rows = []
    for p, board in enumerate(boards):
        row: dict[str, Any] = {**_named(arm, p), "seen": board is not None}
        if board is not None:
            row |= {name: _list(board[name]) for name in NAMES}
        rows.append(row)
    found = [
        {
            **_named(arm, f.patch),
            "tactels": list(f.tactels),
            "found": f.what,
            "advice": f.advice,
        }
        for f in findings(arm, boards)
    ]
    return {"boards": rows, "findings": found}


def _nodes(arm: Arm, patches: Collection[int]) -> str:
    """Return patches as node-IDs, as ranges on an arm of one bus."""
    if len(arm.buses) > 1:
        return f"node {', '.join(map(arm.node_label, patches))}"
    return nodes(arm.node_id[list(patches)].tolist())


def _named(arm: Arm, patch: int) -> dict[str, Any]:
    placed = arm.patches[patch]
    return {"node_id": placed.node_id, "bus": arm.buses[placed.bus].name}


def _list(column: np.ndarray[Any, np.dtype[np.float64]]) -> list[float | None]:
    return [v if math.isfinite(v) else None for v in column.tolist()]
