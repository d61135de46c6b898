"""`skinbus plan coverage`: what the skin of an arm feels where, its worst places, and what it leaves bare."""

from __future__ import annotations

import math
from collections.abc import Iterator
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
    from skinbus.planning.coverage import Coverage

WORST: Final = 5
"""Places of each kind in the table, a board's worst each."""
MOST_BARE: Final = 10
"""Bare areas in the table; the file has all."""
COLUMNS: Final = {
    "least_force": ("least_force_n", "least force, N", 1.0),
    "sd_place": ("sd_place_m", "standard deviation of place, mm", 1e3),
    "sd_force": ("sd_force_n", "standard deviation of force, N", 1.0),
}
"""Name in the file, title and factor to its unit of each column."""


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
    place and force of a contact, by the laws, noises and thresholds in the files of the boards. Level full
    reaches the bound where four tactels feel the contact; the share of such points is printed.

    \b
    Examples:
      skinbus plan coverage forearm
      skinbus plan coverage my-arm.toml --report skin.html --json skin.json
    """
    from skinbus.config.system import load_arm
    from skinbus.planning.coverage import cover

    console = Console()
    with console.status("computing ..."):
        coverage = cover(load_arm(arm, check_load=False), force=force, step=1e-3 * step_mm)
        found = summary(coverage)
    on, name = coverage.board >= 0, coverage.arm.name
    share = coverage.holds[on].mean() if on.any() else 0.0
    facts = [
        f"{name}: {int(on.sum())} points on boards, a contact of {coverage.force:g} N",
        f"level full reaches the bounds on {100 * share:.0f} % of them",
    ]
    tables = {titles: list(rows) for titles, rows in _tables(coverage, found)}
    for text in facts:
        console.print(text)
    for titles, rows in tables.items():
        table = Table(*titles, box=None, pad_edge=False)
        for row in rows:
            table.add_row(*row)
        console.print("", table if rows else "no bare area of a square centimetre")
    if report:
        _write(coverage, facts, tables, report)
        console.print(f"wrote {report}")
    if json_file:
        json_file.write(found)


def summary(coverage: Coverage) -> dict[str, Any]:
    """Return links, worst places and bare areas for programs; null for infinity."""
    import numpy as np

    from skinbus.planning.coverage import bare_areas

    arm, worst = coverage.arm, {}
    for column, (name, _, _) in COLUMNS.items():
        values = getattr(coverage, column)
        on_boards = [np.flatnonzero(coverage.board == p) for p in range(arm.n_patches)]
        places = [here[np.argmax(values[here])] for here in on_boards if len(here)]
        worst[name] = [
            {
                "link": arm.links[coverage.link[i]].name,
                "node_id": arm.patches[coverage.board[i]].node_id,
                "s_m": float(coverage.s[i]),
                "a_m": float(coverage.a[i]),
                "value": _finite(values[i]),
            }
            for i in sorted(places, key=lambda i: -values[i])[:WORST]
        ]
    links = []
    for k, link in enumerate(arm.links):
        own = coverage.link == k
        bare = float(coverage.area[own & (coverage.board < 0)].sum())
        links.append({"name": link.name, "area_m2": float(coverage.area[own].sum()), "bare_m2": bare})
    areas = [
        {
            "link": arm.links[area.link].name,
            "area_m2": area.area,
            "s_m": area.s,
            "a_m": area.a,
            "least_force_n": _finite(area.least_force),
        }
        for area in bare_areas(coverage)
    ]
    return {"arm": arm.name, "force_n": coverage.force, "links": links, "worst": worst, "bare_areas": areas}


def _tables(coverage: Coverage, found: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Return titles and rows: spreads on the boards, worst places, the largest bare areas."""
    import numpy as np

    on = coverage.board >= 0
    spreads, worst, bare = [], [], []
    for column, (name, title, unit) in COLUMNS.items():
        if on.any():
            values = np.quantile(getattr(coverage, column)[on], (0.1, 0.5, 0.9), method="lower")
            spreads.append((title, *(_number(value, unit) for value in values)))
        for place in found["worst"][name]:
            where = str(place["node_id"]), _mm(place["s_m"]), _mm(place["a_m"])
            worst.append((title, place["link"], *where, _number(place["value"], unit)))
    for area in found["bare_areas"][:MOST_BARE]:
        sides = (" to ".join(map(_mm, area[side])) for side in ("s_m", "a_m"))
        bare.append((area["link"], f"{1e4 * area['area_m2']:.1f}", *sides, _number(area["least_force_n"])))
    yield ("on boards", "best tenth", "median", "worst tenth"), spreads
    yield ("worst places", "link", "node-ID", "s mm", "a mm", "value"), worst
    yield ("bare areas", "cm2", "s mm", "a mm", "registers from, N"), bare


def _write(coverage: Coverage, facts: list[str], tables: dict[Any, Any], file: Path) -> None:
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
        half = 500.0 * link.surface.width
        extent = (-half, half, 0.0, 1e3 * link.surface.length)
        for axes, (column, (_, title, unit)) in zip(row, COLUMNS.items(), strict=True):
            values = np.ma.masked_invalid(unit * coverage.grid(k, getattr(coverage, column)))
            picture = axes.imshow(values, norm="log", aspect="equal", origin="lower", extent=extent)
            figure.colorbar(picture, ax=axes, label=title)
            axes.set(title=link.name, xlabel="a (mm)", ylabel="s (mm)")
    report.figure(figure)
    for titles, rows in tables.items():
        report.table(titles, rows)
    report.write(file)


def _finite(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _number(value: float | None, unit: float = 1.0) -> str:
    return "none" if value is None or not math.isfinite(value) else f"{unit * value:.3g}"


def _mm(value: float) -> str:
    return f"{1e3 * value:.0f}"
