"""`skinbus plan coverage`: what the skin of an arm feels where, its worst places, and what it leaves bare."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.options import Range, file_option, json_option
from skinbus.cli.output import JsonFile

if TYPE_CHECKING:
    from skinbus.study.coverage import BareArea, Coverage

WORST = 5
"""Places of each kind in the table, a board's worst each."""
MOST_BARE = 10
"""Bare areas in the table; the file has all."""


@click.command()
@click.argument("arm")
@click.option(
    "--force-n", "force", default=5.0, show_default=True, type=Range(0.01, 1000.0), help="Of the contact, N."
)
@click.option("--step-mm", default=2.0, show_default=True, type=Range(0.5, 20.0), help="Of the grid, mm.")
@file_option(
    "--picture", callback=output.picture, help="Draw the links unrolled to this file (.png, .svg or .pdf)."
)
@json_option
def command(arm: str, force: float, step_mm: float, picture: Path | None, json_file: JsonFile | None) -> None:
    """Compute what the skin of ARM (a name or a TOML file) feels where, before a board is ordered.

    \b
    For each point: the least force that is registered, and the Cramer-Rao bound on the standard deviation of
    place and force of a contact, by the laws, noises and thresholds that the boards' files declare. Level
    full reaches the bound where tactels that feel the contact surround it; their share is printed.

    \b
    Examples:
      skinbus plan coverage forearm
      skinbus plan coverage my-arm.toml --picture skin.png --json skin.json
    """
    from skinbus.config.system import load_arm
    from skinbus.study.coverage import bare_areas, cover

    console = Console()
    with console.status("computing ..."):
        coverage = cover(load_arm(arm, check_load=False), force=force, step=1e-3 * step_mm)
        bare = bare_areas(coverage)
    _show(coverage, bare, console)
    if picture:
        from skinbus.study.coverage_picture import draw

        draw(coverage, picture)
        console.print(f"wrote {picture}")
    if json_file:
        json_file.write(summary(coverage, bare))


def summary(coverage: Coverage, bare: list[BareArea]) -> dict[str, Any]:
    """Return coverage for programs: by link, by board, worst places and bare areas; null for infinity."""
    import numpy as np

    arm = coverage.arm
    boards = []
    for p, placed in enumerate(arm.patches):
        here = np.flatnonzero(coverage.board == p)
        if not len(here):
            continue
        row: dict[str, Any] = {
            "link": arm.links[placed.link].name,
            "bus": arm.buses[placed.bus].name,
            "node_id": placed.node_id,
            "bound_holds": float(coverage.holds[here].mean()),
        }
        for name, column in _columns(coverage).items():
            values = column[here]
            row[name] = {"median": _finite(np.median(values)), "worst": _finite(values.max())}
        boards.append(row)
    links = [
        {
            "name": link.name,
            "area_m2": float(coverage.area[coverage.link == k].sum()),
            "bare": float(coverage.area[(coverage.link == k) & (coverage.board < 0)].sum())
            / float(coverage.area[coverage.link == k].sum()),
        }
        for k, link in enumerate(arm.links)
    ]
    worst = {
        name: [_place(coverage, i) | {"value": _finite(column[i])} for i in _worst(coverage, column)]
        for name, column in _columns(coverage).items()
    }
    return {
        "arm": arm.name,
        "force_n": coverage.force,
        "links": links,
        "boards": boards,
        "worst": worst,
        "bare_areas": [
            {
                "link": arm.links[area.link].name,
                "area_m2": area.area,
                "s_m": list(area.s),
                "a_m": list(area.a),
                "least_force_n": _finite(area.least_force),
            }
            for area in bare
        ],
    }


def _columns(coverage: Coverage) -> dict[str, Any]:
    return {
        "least_force_n": coverage.least_force,
        "sd_place_m": coverage.sd_place,
        "sd_force_n": coverage.sd_force,
    }


def _worst(coverage: Coverage, column: Any) -> list[int]:
    """Return the worst point of each of the worst boards."""
    import numpy as np

    points = [np.flatnonzero(coverage.board == p) for p in range(coverage.arm.n_patches)]
    worst = [int(here[np.argmax(column[here])]) for here in points if len(here)]
    return sorted(worst, key=lambda i: -float(column[i]))[:WORST]


def _place(coverage: Coverage, i: int) -> dict[str, Any]:
    placed = coverage.arm.patches[coverage.board[i]]
    return {
        "link": coverage.arm.links[coverage.link[i]].name,
        "node_id": placed.node_id,
        "s_m": float(coverage.s[i]),
        "a_m": float(coverage.a[i]),
    }


def _finite(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _show(coverage: Coverage, bare: list[BareArea], console: Console) -> None:
    import numpy as np

    arm, on = coverage.arm, coverage.board >= 0
    console.print(f"{arm.name}: {int(on.sum())} points on boards, a contact of {coverage.force:g} N")
    facts = Table(box=None, pad_edge=False)
    for title in ("on boards", "best tenth", "median", "worst tenth"):
        facts.add_column(title, justify="left" if title == "on boards" else "right")
    rows = (
        ("least force, N", coverage.least_force, 1.0),
        ("standard deviation of place, mm", coverage.sd_place, 1e3),
        ("standard deviation of force, N", coverage.sd_force, 1.0),
    )
    for name, column, unit in rows:
        values = np.sort(column[on])
        shown = (values[int(share * (len(values) - 1))] for share in (0.1, 0.5, 0.9))
        facts.add_row(name, *(_number(unit * value) for value in shown))
    console.print(facts)
    share = coverage.holds[on].mean() if on.any() else 0.0
    console.print(f"the bounds are what level full reaches on {100 * share:.0f} % of the boards' area\n")

    table = Table(box=None, pad_edge=False)
    for title in ("worst places", "link", "node-ID", "s mm", "a mm", "value"):
        table.add_column(title, justify="left" if title in ("worst places", "link") else "right")
    for name, column, unit in rows:
        for i in _worst(coverage, column):
            place = _place(coverage, i)
            table.add_row(
                name,
                place["link"],
                str(place["node_id"]),
                f"{1e3 * place['s_m']:.0f}",
                f"{1e3 * place['a_m']:.0f}",
                _number(unit * column[i]),
            )
    console.print(table)
    if not bare:
        console.print("\nno bare area of a square centimetre")
        return
    console.print()
    areas = Table(box=None, pad_edge=False)
    for title in ("bare areas", "cm2", "s mm", "a mm", "registers from"):
        areas.add_column(title, justify="left" if title == "bare areas" else "right")
    for area in bare[:MOST_BARE]:
        least = _number(area.least_force)
        areas.add_row(
            arm.links[area.link].name,
            f"{1e4 * area.area:.1f}",
            f"{1e3 * area.s[0]:.0f} to {1e3 * area.s[1]:.0f}",
            f"{1e3 * area.a[0]:.0f} to {1e3 * area.a[1]:.0f}",
            "not everywhere" if least == "none" else f"{least} N",
        )
    console.print(areas)
    if len(bare) > MOST_BARE:
        console.print(f"and {len(bare) - MOST_BARE} more")


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "none"
