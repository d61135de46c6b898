"""`skinbus study`: what accuracy costs in time, and the paper's figures remade."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.figures import figures_wanted, folder_option
from skinbus.cli.options import file_option
from skinbus.cli.output import echo
from skinbus.cli.progress import progress
from skinbus.cli.study_estimator import estimator
from skinbus.cli.study_headline import headline
from skinbus.cli.study_law import law
from skinbus.cli.study_report import report


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def command() -> None:
    """Measure what accuracy costs in time; remake the paper's figures.

    \b
    Examples:
      skinbus study paper --out docs/figures
    """


@command.command()
@folder_option("--out", default="study-paper", help="Folder for figures (PNG, SVG) and tables (CSV).")
@click.option(
    "--trials",
    default=400,
    show_default=True,
    type=click.IntRange(min=1),
    help="Random touches of each cell.",
)
@click.option(
    "--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Of the random touches."
)
def paper(folder: Path, trials: int, seed: int) -> None:
    """Remake figures 7 to 13 of the paper with all levels of the estimator, and its null zone.

    \b
    Example:
      skinbus study paper --out docs/figures
    """
    from skinbus.study.paper import N_CELLS

    with figures_wanted():
        from skinbus.study.paper_figures import make_all

    console = Console()
    with progress(console, "the paper's figures", N_CELLS) as done:
        files = make_all(folder, trials=trials, seed=seed, done=done)
    console.print(f"{len(files)} files in {folder}")


run_options = [
    click.option(
        "--workers", type=click.IntRange(min=1), help="Processes; as many as processors unless given."
    ),
    click.option("--scheduler", help="Address of a Dask cluster (tcp://host:8786) instead of processes."),
    click.option(
        "--seeds", default=2, show_default=True, type=click.IntRange(min=1), help="Repetitions of the grid."
    ),
]


def with_run_options(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options of everything that runs a grid."""
    for option in reversed(run_options):
        function = option(function)
    return function


@command.command()
@file_option(
    "--out",
    "file",
    default="study.csv",
    show_default=True,
    callback=output.writable,
    help="Table, CSV or *.parquet; rows it already has are not run again.",
)
@with_run_options
@click.option("--quick", is_flag=True, help="A small grid that takes less than a minute.")
@click.option(
    "--compare",
    type=output.Readable(path_type=Path),
    help="Hold the rows against this table; exit with 1 when accuracy or time is worse.",
)
@folder_option("--figures", help="Draw the pictures here.")
def run(
    file: Path,
    workers: int | None,
    scheduler: str | None,
    seeds: int,
    quick: bool,
    compare: Path | None,
    folder: Path | None,
) -> None:
    """Run the grid: methods x families x laws x bits x density x iterations x seeds, one row for each.

    An interrupted run goes on where it was when the same command is given again.

    \b
    Examples:
      skinbus study run --out study.csv --figures figures
      skinbus study run --quick --out quick.csv --compare tests/golden/quick-front.csv
      skinbus study run --scheduler tcp://head:8786
    """
    rows = _run(file, workers=workers, scheduler=scheduler, seeds=seeds, quick=quick)
    if folder:
        _draw(rows, folder)
    if compare:
        from skinbus.study.compare import regressions
        from skinbus.study.sweep import read_table

        faults = regressions(read_table(file), read_table(compare))
        for fault in faults:
            echo(f"worse: {fault}")
        if faults:
            sys.exit(1)
        echo(f"nothing is worse than in {compare}")


@command.command()
@click.argument("table", type=output.Readable(path_type=Path))
@folder_option("--out", default="figures")
def figures(table: Path, folder: Path) -> None:
    """Draw the pictures of a TABLE that `skinbus study run` has made."""
    from skinbus.study.sweep import read_table

    _draw(list(read_table(table).values()), folder)


@command.command("end-to-end")
@folder_option("--out", default="figures")
@click.option(
    "--patches",
    "numbers",
    multiple=True,
    type=click.IntRange(1, 126),
    default=(1, 8, 24, 64, 126),
    show_default=True,
    help="Patches on the bus; may be given several times.",
)
@click.option("--cycles", default=30, show_default=True, type=click.IntRange(min=3), help="Cycles of each.")
def end_to_end(folder: Path, numbers: tuple[int, ...], cycles: int) -> None:
    """Run patches and master on a simulated wire: latency, load and error against the patches on a bus.

    With SYNC at the largest rate that holds, and with patches that send at 100 Hz what has changed.
    """
    from skinbus.study.end_to_end import EndToEndRow, measure_end_to_end, measure_on_change

    with figures_wanted():
        from skinbus.study.front import draw_end_to_end
        from skinbus.study.paper_figures import write_table

    console = Console()
    rows: list[EndToEndRow] = []
    with progress(console, "buses", 4 * len(numbers)) as done:
        for n in numbers:
            for eds in ("skin-patch", "skin-patch-8bit"):
                rows.append(measure_end_to_end(n, eds, cycles=cycles))
                rows.append(measure_on_change(n, eds, cycles=cycles))
                done(2)
    files = [*draw_end_to_end(rows, folder), write_table(folder / "end-to-end.csv", rows)]
    console.print(f"{len(files)} files in {folder}")


@command.command(name="all")
@folder_option("--out", default="docs/figures", help="Folder for figures and tables.")
@with_run_options
@click.pass_context
def everything(
    context: click.Context, folder: Path, workers: int | None, scheduler: str | None, seeds: int
) -> None:
    """Remake every table and figure of docs/accuracy-time.md: the paper's and the grid's."""
    from skinbus.study.sources import write_stamp

    context.invoke(paper, folder=folder, trials=400, seed=0)
    context.invoke(end_to_end, folder=folder, numbers=(1, 8, 24, 64, 126), cycles=30)
    page = folder.parent / "accuracy-time.md"
    context.invoke(
        headline, arms=(), folder=folder, page=page if page.exists() else None, trials=400, seed=16
    )
    table, glance = folder / "headline.csv", folder / "accuracy.html"
    context.invoke(report, arms=(), out=glance, measured=table, trials=400, seed=16)
    rows = _run(folder / "study.csv", workers=workers, scheduler=scheduler, seeds=seeds, quick=False)
    _draw(rows, folder)
    roots = {
        "paper.csv": "paper",
        "end-to-end.csv": "end_to_end",
        "headline.csv": "headline",
        "study.csv": "cell",
    }
    for name, root in roots.items():
        write_stamp(folder, name, f"skinbus study all --out {folder}", [f"skinbus.study.{root}"])


def _run(
    file: Path, *, workers: int | None, scheduler: str | None, seeds: int, quick: bool
) -> list[dict[str, Any]]:
    from skinbus.study.sweep import (
        PARQUET,
        executor_of,
        full_grid,
        need_parquet,
        quick_grid,
        run_sweep,
        write_parquet,
    )

    # Parquet cannot be appended to: rows come into a CSV file beside it, which a killed run goes on from.
    table = file.with_suffix(".csv") if file.suffix == PARQUET else file
    if table is not file:
        need_parquet()  # refused now, not after an hour
    cells = quick_grid() if quick else full_grid(range(seeds))
    console = Console()
    try:
        with (
            progress(console, "cells", len(cells)) as done,
            executor_of(scheduler, workers) as executor,
        ):
            rows = run_sweep(cells, table, executor, done=done)
    except KeyboardInterrupt:
        console.print(f"interrupted; the same command goes on from {table}")
        sys.exit(130)
    if table is not file:
        write_parquet(rows, file)
    return rows


def _draw(rows: Sequence[dict[str, Any]], folder: Path) -> None:
    with figures_wanted():
        from skinbus.study.front import make_figures, missing

    files = make_figures(rows, folder)
    echo(f"{len(files)} pictures in {folder}")
    if gaps := missing(rows):
        echo(f"empty where the table has no rows: {', '.join(gaps)}")


command.add_command(estimator)
command.add_command(headline)
command.add_command(law)
command.add_command(report)
