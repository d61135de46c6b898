"""`skinbus doctor health`: what changed in each tactel since commissioning, and what to replace."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np

from skinbus.cli.console import Console
from skinbus.cli.formatting import span
from skinbus.cli.options import file_option
from skinbus.cli.state_keeper import load_health
from skinbus.config.system import load_arm
from skinbus.master.health import SAMPLE_NS, SETTLED, Records, findings
from skinbus.model import Arm

STATE = Path("/var/lib/skinbus/state")
"""Of the service."""
COLUMNS = ("noise", "noise_first", "zero", "zero_first", "touches", "faults")


@click.command()
@click.argument("arm")
@file_option(
    "--state",
    default=STATE,
    show_default=True,
    help="The state that `skinbus run --state` keeps; the health is beside it.",
)
def command(arm: str, state: Path) -> None:
    """Show how the tactels of ARM have changed since they were commissioned, and what to do.

    A master that runs with --state records noise, zero, touches and faults of each tactel. Each board is
    compared with its state at commissioning, when the master first read its serial number and calibration.

    Status 0: nothing to do, or not commissioned yet. 1: findings. 2: no such arm, or no health.

    \b
    Examples:
      skinbus doctor health my-arm.toml --state my-arm.state
    """
    loaded, console = load_arm(arm), Console()
    boards = load_health(loaded, state)
    console.table(
        ("node", "noise, Pa", "was", "zero, Pa", "was", "touches", "faults"),
        rows_of(loaded, boards),
    )
    found = list(check_health(loaded, boards))
    for what, advice in found:
        console.print(
            f"{what}\n  -> {advice}" if advice else what, style="yellow" if advice else "", soft_wrap=True
        )
    sys.exit(1 if any(advice for _, advice in found) else 0)


def check_health(arm: Arm, boards: Sequence[Records | None]) -> Iterator[tuple[str, str]]:
    """Return what changed and what to do about it, or that nothing did."""
    found = findings(arm, boards)
    for own in found:
        which = f" tactel{'s' if len(own.tactels) > 1 else ''} {span(own.tactels)}" if own.tactels else ""
        yield f"node {arm.node_label(own.patch)}{which}: {own.what}", own.advice
    samples = {
        arm.node_label(p): int(board["samples"].max())
        for p, board in enumerate(boards)
        if board is not None and not np.isfinite(board["noise_first"]).any()
    }
    if samples:
        minutes = math.ceil(max(SETTLED - min(samples.values()), 1) * SAMPLE_NS / 60e9)
        yield (
            f"node {', '.join(samples)}: not commissioned yet, so nothing is compared; {minutes} min to go "
            "while the master runs and nothing touches them",
            "",
        )
    elif not found:
        yield "nothing to do", ""


def rows_of(arm: Arm, boards: Sequence[Records | None]) -> Iterator[list[str]]:
    """Return boards as rows: medians of their tactels, and sums of counts."""
    for p, board in enumerate(boards):
        if board is None:
            yield [arm.node_label(p), "not seen", *[""] * 5]
            continue
        known = [board[name][np.isfinite(board[name])] for name in COLUMNS]
        values = [np.median(column) if len(column) else math.nan for column in known[:-2]]
        values += [column.sum() for column in known[-2:]]
        yield [arm.node_label(p), *(f"{x:.0f}" if math.isfinite(x) else "-" for x in values)]
