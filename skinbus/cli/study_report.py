"""`skinbus study report`: a page that says what accuracy costs on an arm, and which level to run."""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.formatting import counted
from skinbus.cli.options import file_option
from skinbus.cli.output import echo
from skinbus.cli.progress import progress
from skinbus.errors import ConfigError, Fault, FaultList

if TYPE_CHECKING:
    from skinbus.model import Arm
    from skinbus.study.headline import Point


@click.command()
@click.argument("arms", metavar="[ARM]...", nargs=-1)
@file_option(
    "--out", default="accuracy.html", show_default=True, callback=output.html, help="The page to write."
)
@click.option(
    "--table",
    "measured",
    type=output.Readable(path_type=Path),
    help="Show what `skinbus study headline` wrote to this file (headline.csv) instead of measuring.",
)
@click.option(
    "--trials", type=click.IntRange(min=20), default=400, show_default=True, help="Cycles of each point."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=16, show_default=True, help="Of all random draws."
)
def report(arms: tuple[str, ...], out: Path, measured: Path | None, trials: int, seed: int) -> None:
    """Write a page on each ARM (a name or a TOML file): error against time, and which level to run.

    The page is one file that fetches nothing. Points are levels with readings of 8 and 16 bits, on a
    calibrated skin pushed straight and on one as it ships under inclined pushes, and level full with less
    time than it needs; they show their numbers when pointed at. Run it on the machine of the master:
    computing is measured, the wire is computed. The shipped arms unless others are named.

    \b
    Examples:
      skinbus study report my-arm.toml --out accuracy.html
      skinbus study report --table figures/headline.csv
    """
    from skinbus.cli.pages.accuracy import accuracy_page
    from skinbus.config.system import load_arm
    from skinbus.study.headline import (
        ARMS,
        measure_budgets,
        measure_headline,
        n_points,
    )

    names = arms or ARMS
    points: list[Point] = []
    if measured:
        points = read_points(measured)
        if arms:
            points = [point for point in points if point.arm in arms]
        if not points:
            raise ConfigError(str(measured), [Fault("arm", None, f"points of {' or '.join(names)}")])
        known = {point.arm for point in points}
        loaded = [load_arm(name, check_load=False) for name in ARMS if name in known]
        made = f"Points were read from {measured.name}, the table of skinbus study headline."
    else:
        loaded = [load_arm(name, check_load=False) for name in names]
        try:
            with progress(Console(), "points", len(loaded) * (n_points() + 6)) as done:
                for arm in loaded:
                    own = measure_headline(arm, trials=trials, seed=seed, done=done)
                    points += [*own, *measure_budgets(arm, own, trials=trials, seed=seed, done=done)]
        except KeyboardInterrupt:
            echo("interrupted; nothing is written", err=True)
            sys.exit(130)
        made = f"{trials} cycles for each point, seed {seed}; computing was measured on this machine."
    made += f" {conditions()}"
    out.write_text(accuracy_page(points, {arm.name: facts(arm) for arm in loaded}, made), encoding="utf-8")
    echo(f"{out}: {len(points)} points of {', '.join(dict.fromkeys(point.arm for point in points))}")


def conditions() -> str:
    """Return what was pressed, and how."""
    from skinbus.study.headline import FINGERS, FORCES, NOISE

    diameters = ", ".join(f"{1e3 * d:g}" for d in FINGERS)
    return (
        f"Fingertips of {diameters} mm press {FORCES[0]:g} to {FORCES[1]:g} N anywhere on the boards; "
        f"the simulated layer is elastic, with noise of {NOISE:g} Pa. The wire is the worst case that "
        "skinbus plan computes."
    )


def facts(arm: Arm) -> str:
    """Return what an arm is, in one line."""
    buses = f"{len(arm.buses)} buses" if len(arm.buses) > 1 else "one bus"
    return (
        f"{counted(arm.n_patches, 'board')} with {arm.n_tactels} tactels on {buses} of "
        f"{1e-6 * arm.bus.bitrate:g} Mbit/s, SYNC at {arm.bus.rate_hz:g} Hz or what the bus holds"
    )


def read_points(file: Path) -> list[Point]:
    """Return the points in a table of `skinbus study headline`.

    Raises:
        ConfigError: it is none, with all faults.
    """
    from skinbus.estimate import LEVELS
    from skinbus.study.headline import CONDITIONS, Point

    faults, points = FaultList(), []
    with file.open(encoding="utf-8", errors="replace", newline="") as lines:
        reader = csv.DictReader(lines)
        names = list(Point.__dataclass_fields__)
        if missing := sorted(set(names) - set(reader.fieldnames or ())):
            raise ConfigError(str(file), [Fault("columns", None, ", ".join(missing))])
        choices = {"level": LEVELS, "condition": [c.name for c in CONDITIONS], "fingers": ("1", "2")}
        for row in reader:
            found = _point(row, names, choices, f"line {reader.line_num}", faults)
            if found:
                points.append(Point(**found))
    if faults or not points:
        raise ConfigError(str(file), faults or [Fault("rows", None, "at least one point")])
    return points


def _point(
    row: dict[str, Any],
    names: Sequence[str],
    choices: dict[str, Sequence[str]],
    where: str,
    faults: FaultList,
) -> dict[str, Any] | None:
    """Return the values of a row; faults are noted."""
    found: dict[str, Any] = {}
    n_before = len(faults) + faults.n_more
    for name in names:
        value = row[name]
        if name in choices and value not in choices[name]:
            faults.append(Fault(f"{where} {name}", value, f"one of {', '.join(choices[name])}"))
        elif name in ("arm", "condition", "level"):
            found[name] = value
        else:
            try:
                number = float(value)
                if not 0.0 <= number < 1e12 or (name not in ("wrong_count_pct",) and number == 0.0):
                    raise ValueError
            except (TypeError, ValueError):
                faults.append(Fault(f"{where} {name}", value, "a positive number"))
                continue
            found[name] = int(number) if name in ("fingers", "bits") else number
    return found if len(faults) + faults.n_more == n_before else None
