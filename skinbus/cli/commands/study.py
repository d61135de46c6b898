"""`skinbus study`: accuracy against time of an arm, and the paper's figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.options import file_option
from skinbus.cli.output import echo
from skinbus.cli.progress import progress
from skinbus.cli.report import figures_wanted, write_page

folder_type = click.Path(file_okay=False, path_type=Path)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def command() -> None:
    """Measure what accuracy costs in time; remake the paper's figures.

    \b
    Examples:
      skinbus study paper --out docs/figures
    """


@command.command()
@click.argument("arms", metavar="[ARM]...", nargs=-1)
@file_option(
    "--out", default="accuracy.html", show_default=True, callback=output.html, help="The report to write."
)
@click.option(
    "--trials", type=click.IntRange(min=20), default=400, show_default=True, help="Cycles of each point."
)
@click.option(
    "--figures",
    "folder",
    type=folder_type,
    callback=output.folder,
    help="Also write accuracy.csv and a figure for each arm (SVG) here.",
)
def arm(
    arms: tuple[str, ...],
    out: Path,
    trials: int,
    folder: Path | None,
) -> None:
    """Measure error against time for each ARM (a name or a TOML file; forearm), and say which level to run.

    Points are the levels with readings of 8 and 16 bits, on a calibrated skin pushed straight and on one as
    it ships under inclined pushes. Computing is measured on this machine, the wire is the worst case that
    `skinbus plan` computes. Differences below the scatter are ties, and the cheaper level wins them.

    \b
    Examples:
      skinbus study arm my-arm.toml
      skinbus study arm --figures figures
    """
    from skinbus.config.system import load_arm
    from skinbus.study import arm_study
    from skinbus.study.paper import write_table

    with figures_wanted():
        from skinbus.study.draw import save

    loaded = [load_arm(name, check_load=False) for name in arms or ("forearm",)]
    names = ", ".join(arm.name for arm in loaded)
    about = (
        f"{trials} cycles for each point. Fingertips of 10 to 15 mm press 2 to 12 N anywhere on "
        "the boards; the simulated layer is elastic. The error of a cycle is that of its worst touch; "
        "a wrong count is an error of a pitch at least."
    )
    points: list[Any] = []
    shown: list[tuple[str, Any]] = [("", about)]
    with progress(Console(), "points", len(loaded) * arm_study.N_POINTS) as done:
        for one in loaded:
            own = arm_study.measure_arm(one, trials=trials, done=done)
            figure = arm_study.draw_arm(own)
            shown.append((one.name, figure))
            if folder:
                save(figure, folder, f"accuracy-{one.name.replace(' ', '-')}")
            points += own
    rows = arm_study.table(points)
    shown.append(("Which level to run", [arm_study.TITLES, *rows]))
    write_page(out, f"What accuracy costs in time: {names}", shown)
    if folder:
        write_table(folder / "accuracy.csv", points)
    echo(f"{out}: {len(points)} points of {names}")


@command.command()
@click.option(
    "--out",
    "folder",
    default="study-paper",
    show_default=True,
    type=folder_type,
    callback=output.folder,
    help="Folder for figures (SVG) and tables (CSV).",
)
@click.option(
    "--trials",
    default=400,
    show_default=True,
    type=click.IntRange(min=1),
    help="Random touches of each cell.",
)
def paper(folder: Path, trials: int) -> None:
    """Remake figures 7 to 13 of the paper with all levels of the estimator, and its null zone.

    \b
    Example:
      skinbus study paper --out docs/figures
    """
    from skinbus.study.paper import N_CELLS, make_all

    with figures_wanted():
        import skinbus.study.draw  # noqa: F401  refused now, not after minutes

    console = Console()
    with progress(console, "the paper's figures", N_CELLS) as done:
        files = make_all(folder, trials=trials, seed=0, done=done)
    console.print(f"{len(files)} files in {folder}")
