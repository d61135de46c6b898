"""`skinbus study estimator`: how near the estimator is to the Cramer-Rao bound; the tables of the docs."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from skinbus.cli.console import Console
from skinbus.cli.output import echo
from skinbus.cli.progress import progress


@click.command()
@click.option(
    "--out",
    "file",
    type=click.Path(exists=True, dir_okay=False, writable=True, path_type=Path),
    help="Document whose tables are replaced; else they are printed.",
)
@click.option("--quick", is_flag=True, help="A twentieth of the cases: a minute instead of many.")
@click.option("--seed", type=click.IntRange(min=0), help="Of all random draws; the tables' own unless given.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes; as many as processors unless given.")
def estimator(file: Path | None, quick: bool, seed: int | None, workers: int | None) -> None:
    """Measure errors against the Cramer-Rao bound, counts, covariances and time.

    It exits with 1 when a limit is missed.

    \b
    Examples:
      skinbus study estimator --quick
      skinbus study estimator --out docs/estimator.md
    """
    from skinbus.study.accuracy_table import (
        MARKS,
        SEED,
        measure,
        missed,
        pieces,
        write_tables,
    )
    from skinbus.study.accuracy_time import measure_times, write_times
    from skinbus.study.sources import write_stamp
    from skinbus.study.surrogate_table import measure_surrogates, missed_surrogates, write_surrogates
    from skinbus.study.sweep import executor_of

    seed = SEED if seed is None else seed
    if file is not None:
        MARKS.read(file)  # refused now, not after an hour
    console = Console()
    try:
        with (
            progress(console, "pieces", len(pieces(quick=quick))) as done,
            executor_of(None, workers) as executor,
        ):
            tallies = measure(executor, seed=seed, quick=quick, done=done)
            console.print("skins as they are")
            surrogates = measure_surrogates(executor, seed=seed, quick=quick)
        console.print("time and memory, on one processor")
        times = measure_times(seed, rounds=30 if quick else 300)
    except KeyboardInterrupt:
        console.print("interrupted; nothing is written")
        sys.exit(130)
    tables = "\n".join([write_tables(tallies, seed=seed), write_surrogates(surrogates), write_times(times)])
    if file is None:
        echo(tables)
    else:
        MARKS.write(file, tables)
        roots = [f"skinbus.study.{name}" for name in ("accuracy_table", "accuracy_time", "surrogate_table")]
        write_stamp(file.parent, file.name, f"skinbus study estimator --out {file}", roots)
        echo(f"tables in {file}")
    lines = missed(tallies) + missed_surrogates(surrogates) + times.missed()
    for line in lines:
        echo(f"missed: {line}")
    sys.exit(1 if lines else 0)
