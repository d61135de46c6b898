"""`skinbus study headline`: which level to run, from one picture and one table for each arm."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from skinbus.cli.console import Console
from skinbus.cli.figures import figures_wanted, folder_option
from skinbus.cli.output import echo
from skinbus.cli.progress import progress


@click.command()
@click.argument("arms", metavar="[ARM]...", nargs=-1)
@folder_option("--out", default="figures", help="Folder for pictures (PNG, SVG) and the table (CSV).")
@click.option(
    "--page",
    type=click.Path(exists=True, dir_okay=False, writable=True, path_type=Path),
    help="Document whose table of decisions is replaced; else it is printed.",
)
@click.option(
    "--trials", type=click.IntRange(min=20), default=400, show_default=True, help="Cycles of each point."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=16, show_default=True, help="Of all random draws."
)
def headline(arms: tuple[str, ...], folder: Path, page: Path | None, trials: int, seed: int) -> None:
    """Draw error against latency of each ARM (a name or a TOML file), and say which level to run.

    The error is that of 95 of 100 cycles; a missed, false or merged touch counts as a pitch at least. One
    finger and two, a calibrated skin and one as it ships. The shipped arms unless others are named.

    \b
    Examples:
      skinbus study headline my-arm.toml --out figures
      skinbus study headline --out docs/figures --page docs/accuracy-time.md
    """
    from skinbus.config.system import load_arm
    from skinbus.study.headline import ARMS, measure_headline, n_points
    from skinbus.study.headline_figure import MARKS, write_decisions
    from skinbus.study.sources import write_stamp

    with figures_wanted():
        from skinbus.study.headline_figure import draw_headline
        from skinbus.study.paper_figures import write_table

    if page is not None:
        MARKS.read(page)  # refused now, not after minutes
    loaded = [load_arm(name, check_load=False) for name in arms or ARMS]
    console, points, files = Console(), [], []
    try:
        with progress(console, "points", len(loaded) * n_points()) as done:
            for arm in loaded:
                own = measure_headline(arm, trials=trials, seed=seed, done=done)
                files += draw_headline(own, folder)
                points += own
    except KeyboardInterrupt:
        console.print("interrupted; nothing is written but the pictures of arms that are done")
        sys.exit(130)
    files.append(write_table(folder / "headline.csv", points))
    decisions = write_decisions(points)
    if page is None:
        echo(decisions)
    else:
        MARKS.write(page, decisions)
        command = f"skinbus study headline --trials {trials} --out {folder} --page {page}"
        write_stamp(folder, "headline.csv", command, ["skinbus.study.headline"])
    console.print(f"{len(files)} files in {folder}")
