"""`skinbus study`: what accuracy costs in time, and the paper's figures remade."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from skinbus.errors import SkinbusError


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def command() -> None:
    """Measure what accuracy costs in time; remake the paper's figures."""


@command.command()
@click.option(
    "--out",
    "folder",
    default="study-paper",
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for figures (PNG, SVG) and tables (CSV).",
)
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


@contextmanager
def figures_wanted() -> Iterator[None]:
    """Turn a missing matplotlib into one clear message."""
    try:
        yield
    except ImportError as error:
        raise SkinbusError(f"figures need matplotlib ({error}); pip install 'skinbus[figures]'") from error


@contextmanager
def progress(console: Console, text: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
    """Show a bar with the time left; what is given moves it on by a number of cells."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(text, total=total, completed=done)
        yield lambda n: bar.advance(task, n)
