"""`skinbus plan coverage`: what the skin of an arm feels where, its worst places, and what it leaves bare."""

from __future__ import annotations

import math
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
"""Places of each kind, a board's worst each."""
COLUMNS: Final = {
    "least_force": ("least force, N", 1.0),
    "sd_place": ("standard deviation of place, mm", 1e3),
    "sd_force": ("standard deviation of force, N", 1.0),
}
"""Name of each column, and the factor to its unit."""


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
        tables = _tables(coverage)
    on, name = coverage.board >= 0, coverage.arm.name
    share = coverage.holds[on].mean() if on.any() else 0.0
    facts = [
        f"{name}: {int(on.sum())} points on boards, a contact of {coverage.force:g} N",
        f"level full reaches the bounds on {100 * share:.0f} % of them",
    ]
    for text in facts:
        console.print(text)
    for title, rows in tables.items():
        table = Table(title, *list(rows[0])[1:] if rows else (), box=None, pad_edge=False)
        for row in rows:
            table.add_row(*map(_text, row.values()))
        console.print()
        console.print(table if rows else f"{title}: none of a square centimetre")
    if report:
        _write(coverage, facts, tables, report)
        console.print(f"wrote {report}")
    if json_file:
        json_file.write({"arm": name, "force_n": coverage.force, "bound_holds": float(share), **tables})


def _tables(coverage: Coverage) -> dict[str, list[dict[str, Any]]]:
    """Return spreads on the boards, worst places and bare areas; None for infinity."""
    import numpy as np

    from skinbus.planning.coverage import bare_areas

    arm, on = coverage.arm, coverage.board >= 0
    spreads, worst = [], []
    for column, (name, unit) in COLUMNS.items():
        values = unit * getattr(coverage, column)
        quantiles = np.quantile(values[on], (0.1, 0.5, 0.9), method="lower") if on.any() else [np.nan] * 3
        spreads.append(
            {"what": name}
            | dict(zip(("best_tenth", "median", "worst_tenth"), map(_finite, quantiles), strict=True))
        )
        on_boards = [np.flatnonzero(coverage.board == p) for p in range(arm.n_patches)]
        places = [here[np.argmax(values[here])] for here in on_boards if len(here)]
        worst += [
            {
                "what": name,
                "link": arm.links[coverage.link[i]].name,
                "node_id": arm.patches[coverage.board[i]].node_id,
                "s_mm": _finite(1e3 * coverage.s[i]),
                "a_mm": _finite(1e3 * coverage.a[i]),
                "value": _finite(values[i]),
            }
            for i in sorted(places, key=lambda i: -values[i])[:WORST]
        ]
    bare = [
        {
            "link": arm.links[area.link].name,
            "area_cm2": _finite(1e4 * area.area),
            "s_mm": [_finite(1e3 * end) for end in area.s],
            "a_mm": [_finite(1e3 * end) for end in area.a],
            "least_force_n": _finite(area.least_force),
        }
        for area in bare_areas(coverage)
    ]
    return {"on_boards": spreads, "worst_places": worst, "bare_areas": bare}


def _write(coverage: Coverage, facts: list[str], tables: dict[str, Any], file: Path) -> None:
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
        for axes, (column, (name, unit)) in zip(row, COLUMNS.items(), strict=True):
            values = np.ma.masked_invalid(unit * coverage.grid(k, getattr(coverage, column)))
            picture = axes.imshow(values, norm="log", aspect="equal", origin="lower", extent=extent)
            figure.colorbar(picture, ax=axes, label=name)
            axes.set(title=link.name, xlabel="a (mm)", ylabel="s (mm)")
    report.figure(figure)
    for title, rows in tables.items():
        report.heading(title)
        report.table(list(rows[0]) if rows else (), [[*map(_text, row.values())] for row in rows])
    report.write(file)


def _finite(value: Any) -> float | None:
    return float(f"{value:.4g}") if math.isfinite(value) else None


def _text(value: Any) -> str:
    if isinstance(value, list):
        return " to ".join(map(_text, value))
    return "none" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)
