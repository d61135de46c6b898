"""`skinbus plan coverage`: what the skin of an arm feels where, its worst places, and what it leaves bare."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from rich.table import Table

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.figures import figures_wanted
from skinbus.cli.options import Range, file_option, json_option
from skinbus.cli.output import JsonFile

if TYPE_CHECKING:
    from skinbus.planning.coverage import BareArea, Coverage

WORST: Final = 5
"""Places of each kind in the table, a board's worst each."""
MOST_BARE: Final = 10
"""Bare areas in the table; the file has all."""
COLUMNS: Final = (
    ("least_force", "least_force_n", "least force, N", 1.0),
    ("sd_place", "sd_place_m", "standard deviation of place, mm", 1e3),
    ("sd_force", "sd_force_n", "standard deviation of force, N", 1.0),
)
"""Column, its name in the file, its title, and the factor to its unit."""


@click.command()
@click.argument("arm")
@click.option(
    "--force-n", "force", default=5.0, show_default=True, type=Range(0.01, 1000.0), help="Of the contact, N."
)
@click.option("--step-mm", default=2.0, show_default=True, type=Range(0.5, 20.0), help="Of the grid, mm.")
@file_option("--report", callback=output.html, help="Write a report with the links unrolled (.html).")
@json_option
def command(arm: str, force: float, step_mm: float, report: Path | None, json_file: JsonFile | None) -> None:
    """Compute what the skin of ARM (a name or a TOML file) feels where, before a board is ordered.

    \b
    For each point: the least force that is registered, and the Cramer-Rao bound on the standard deviation of
    place and force of a contact, by the laws, noises and thresholds that the boards' files declare. Level
    full reaches the bound where tactels that feel the contact surround it; their share is printed.

    \b
    Examples:
      skinbus plan coverage forearm
      skinbus plan coverage my-arm.toml --report skin.html --json skin.json
    """
    from skinbus.config.system import load_arm
    from skinbus.planning.coverage import bare_areas, cover

    console = Console()
    with console.status("computing ..."):
        coverage = cover(load_arm(arm, check_load=False), force=force, step=1e-3 * step_mm)
        bare = bare_areas(coverage)
    on, name = coverage.board >= 0, coverage.arm.name
    facts = [
        f"{name}: {int(on.sum())} points on boards, a contact of {coverage.force:g} N",
        "the bounds are what level full reaches on "
        f"{100 * (coverage.holds[on].mean() if on.any() else 0.0):.0f} % of the boards' area",
    ]
    tables = _tables(coverage, bare)
    for text in facts:
        console.print(text)
    for titles, rows in tables:
        table = Table(box=None, pad_edge=False)
        for title in titles:
            table.add_column(title)
        for row in rows:
            table.add_row(*row)
        console.print()
        console.print(table if rows else "no bare area of a square centimetre")
    if report:
        _write(coverage, facts, tables, report)
        console.print(f"wrote {report}")
    if json_file:
        json_file.write(summary(coverage, bare))


def _tables(coverage: Coverage, bare: list[BareArea]) -> list[tuple[tuple[str, ...], list[tuple[str, ...]]]]:
    """Return titles and rows: spreads on the boards, worst places, the largest bare areas."""
    import numpy as np

    spreads: list[tuple[str, ...]] = []
    worst: list[tuple[str, ...]] = []
    areas: list[tuple[str, ...]] = []
    for column, _, title, unit in COLUMNS:
        values = np.sort(getattr(coverage, column)[coverage.board >= 0])
        shown = (values[int(share * (len(values) - 1))] for share in (0.1, 0.5, 0.9) if len(values))
        spreads.append((title, *(_number(unit * value) for value in shown)))
        for i in _worst(coverage, column):
            at = _place(coverage, i)
            place = f"{1e3 * at['s_m']:.0f}", f"{1e3 * at['a_m']:.0f}"
            value = _number(unit * getattr(coverage, column)[i])
            worst.append((title, at["link"], str(at["node_id"]), *place, value))
    for area in bare[:MOST_BARE]:
        least = "not everywhere" if math.isinf(area.least_force) else f"{_number(area.least_force)} N"
        extents = (f"{1e3 * low:.0f} to {1e3 * high:.0f}" for low, high in (area.s, area.a))
        areas.append((coverage.arm.links[area.link].name, f"{1e4 * area.area:.1f}", *extents, least))
    return [
        (("on boards", "best tenth", "median", "worst tenth"), spreads),
        (("worst places", "link", "node-ID", "s mm", "a mm", "value"), worst),
        (("bare areas", "cm2", "s mm", "a mm", "registers from"), areas),
    ]


def summary(coverage: Coverage, bare: list[BareArea]) -> dict[str, Any]:
    """Return coverage for programs: by link, by board, worst places and bare areas; null for infinity."""
    import numpy as np

    arm, boards, links = coverage.arm, [], []
    for p, placed in enumerate(arm.patches):
        here = np.flatnonzero(coverage.board == p)
        if len(here):
            row: dict[str, Any] = {"link": arm.links[placed.link].name, "bus": arm.buses[placed.bus].name}
            row |= {"node_id": placed.node_id, "bound_holds": float(coverage.holds[here].mean())}
            for column, name, _, _ in COLUMNS:
                values = getattr(coverage, column)[here]
                row[name] = {"median": _finite(np.median(values)), "worst": _finite(values.max())}
            boards.append(row)
    for k, link in enumerate(arm.links):
        own = coverage.link == k
        area = float(coverage.area[own].sum())
        bare_share = float(coverage.area[own & (coverage.board < 0)].sum()) / area
        links.append({"name": link.name, "area_m2": area, "bare": bare_share})
    return {
        "arm": arm.name,
        "force_n": coverage.force,
        "links": links,
        "boards": boards,
        "worst": {
            name: [
                _place(coverage, i) | {"value": _finite(getattr(coverage, column)[i])}
                for i in _worst(coverage, column)
            ]
            for column, name, _, _ in COLUMNS
        },
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


def _worst(coverage: Coverage, column: str) -> list[int]:
    """Return the worst point of each of the worst boards."""
    import numpy as np

    values = getattr(coverage, column)
    points = [np.flatnonzero(coverage.board == p) for p in range(coverage.arm.n_patches)]
    worst = [int(here[np.argmax(values[here])]) for here in points if len(here)]
    return sorted(worst, key=lambda i: -float(values[i]))[:WORST]


def _place(coverage: Coverage, i: int) -> dict[str, Any]:
    placed = coverage.arm.patches[coverage.board[i]]
    return {
        "link": coverage.arm.links[coverage.link[i]].name,
        "node_id": placed.node_id,
        "s_m": float(coverage.s[i]),
        "a_m": float(coverage.a[i]),
    }


def _write(
    coverage: Coverage,
    facts: Sequence[str],
    tables: Sequence[tuple[Sequence[str], Sequence[Sequence[str]]]],
    file: Path,
) -> None:
    """Write the report: the links unrolled, and the tables."""
    import numpy as np

    from skinbus.cli.report import Report

    with figures_wanted():
        from skinbus.study.draw import new_figure

    report = Report(f"What the skin of {coverage.arm.name} feels")
    for text in facts:
        report.paragraph(text)
    figure, panels = new_figure(len(COLUMNS), len(coverage.arm.links), width=4.5)
    for k, (link, row) in enumerate(zip(coverage.arm.links, panels, strict=True)):
        ends = [0.0, 1e3 * link.surface.length], 500.0 * link.surface.width
        for axes, (column, _, title, unit) in zip(row, COLUMNS, strict=True):
            values = unit * coverage.grid(k, getattr(coverage, column))
            shown = np.where(np.isfinite(values), values, np.nan)
            picture = axes.imshow(
                shown, norm="log", aspect="equal", origin="lower", extent=(-ends[1], ends[1], *ends[0])
            )
            figure.colorbar(picture, ax=axes, label=title)
            axes.set(title=link.name, xlabel="a (mm)", ylabel="s (mm)")
    report.figure(figure)
    for titles, rows in tables:
        report.table(titles, rows)
    report.write(file)


def _finite(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "none"
