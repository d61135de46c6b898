"""Makes docs/hard-cases.md anew: ``python -m tests.hard``; ``--help`` lists the options."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console

from skinbus.cli.progress import progress
from skinbus.study.sources import write_stamp
from tests.hard.page import MARKS, N_STEPS, make_page


@click.command()
@click.option(
    "--page",
    default="docs/hard-cases.md",
    show_default=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Page whose marked part is written.",
)
@click.option(
    "--figures",
    default="docs/figures",
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the curves.",
)
@click.option(
    "--cycles", default=20_000, show_default=True, type=click.IntRange(min=1), help="Of random extremes."
)
@click.option(
    "--answers", default=100_000, show_default=True, type=click.IntRange(min=100), help="Of each scatter."
)
@click.option("--seed", default=1, show_default=True, type=click.IntRange(min=0))
def main(page: Path, figures: Path, cycles: int, answers: int, seed: int) -> None:
    """Measure the hard cases and write them to their page; exit with 1 when something does not hold."""
    MARKS.read(page)  # refused now, not after minutes
    with progress(Console(), "hard cases", N_STEPS) as done:
        faults = make_page(page, figures, cycles=cycles, answers=answers, seed=seed, done=done)
    write_stamp(page.parent, page.name, "python -m tests.hard", ["skinbus.estimate.estimator"])
    for fault in faults:
        click.echo(fault)
    sys.exit(1 if faults else 0)


main()
