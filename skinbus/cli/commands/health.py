"""`skinbus doctor health`: what changed in each tactel since commissioning, and what to replace."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np

from skinbus.cli.console import Console
from skinbus.cli.options import file_option
from skinbus.cli.state_keeper import load_health
from skinbus.config.system import load_arm
from skinbus.formatting import span
from skinbus.master.health import SAMPLE_NS, SETTLED, Records, findings
from skinbus.model import Arm

STATE = Path("/var/lib/skinbus/state")
"""Of the service."""


@click.command()
@click.argument("arm")
@file_option(
    "--state",
    default=STATE,
    help="The state that `skinbus run --state` keeps; the health is beside it.",
)
def command(arm: str, state: Path) -> None:
    """Show how the tactels of ARM have changed since they were commissioned, and what to do.

    A master that runs with --state records noise, zero and faults of each tactel. Each board is
    compared with its state at commissioning, when the master first read its serial number and calibration.

    Status 0: nothing to do, or not commissioned yet. 1: findings. 2: no such arm, or no health.

    \b
    Examples:
      skinbus doctor health my-arm.toml --state my-arm.state
    """
    loaded, console = load_arm(arm), Console()
    boards = load_health(loaded, state)
    found = list(check_health(loaded, boards))
    for what, advice in found:
        console.print(f"{what}\n  -> {advice}" if advice else what, style="yellow" if advice else "")
    sys.exit(1 if any(advice for _, advice in found) else 0)


def check_health(arm: Arm, boards: Sequence[Records | None]) -> Iterator[tuple[str, str]]:
    """Return what changed and what to do about it, or that nothing did."""
    found = list(findings(arm, boards))
    for own in found:
        which = f" tactel{'s' if len(own.tactels) > 1 else ''} {span(own.tactels)}" if own.tactels else ""
        yield f"node {arm.node_label(own.patch)}{which}: {own.what}", own.advice
    new = [
        arm.node_label(p)
        for p, board in enumerate(boards)
        if board is None or not np.isfinite(board["noise_first"]).any()
    ]
    if new:
        minutes = math.ceil(SETTLED * SAMPLE_NS / 60e9)
        how = f"it takes {minutes} min while the master runs and nothing touches them"
        yield f"node {', '.join(new)}: not commissioned yet, so nothing is compared; {how}", ""
    elif not found:
        yield "nothing to do", ""
