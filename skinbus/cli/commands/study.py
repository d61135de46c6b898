"""`skinbus study`: accuracy against time of an arm, and the paper's figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from skinbus.cli.console import Console
from skinbus.cli.progress import progress
from skinbus.errors import extra_wanted


def _out(name: str) -> Any:
    """Return --out, a folder."""
    kind = click.Path(file_okay=False, path_type=Path)
    return click.option(
        "--out",
        "folder",
        default=name,
        type=kind,
        help="Folder for figures (SVG) and tables (CSV).",
    )


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def command() -> None:
    """Measure what accuracy costs in time; remake the paper's figures.

    \b
    Examples:
      skinbus study paper --out docs/figures
    """


@command.command()
@click.argument("arms", metavar="[ARM]...", nargs=-1)
@_out("study-arm")
def arm(arms: tuple[str, ...], folder: Path) -> None:
    """Measure error against time for each ARM.

    ARM is a name or a TOML file, by default forearm. The command says which level to run.
    Each level is measured with readings of 8 and 16 bits, on a calibrated skin under straight pushes and on
    an uncalibrated skin under inclined pushes. Computing is measured on this machine, the wire is the worst
    case that `skinbus plan` computes. If two levels differ by less than the scatter, the cheaper one is
    named.

    \b
    Example:
      skinbus study arm my-arm.toml --out my-arm
    """
    from skinbus.config.system import load_arm
    from skinbus.study import arm_study
    from skinbus.study.paper import write_table

    with extra_wanted("figures"):
        from skinbus.study.draw import save

    folder.mkdir(parents=True, exist_ok=True)
    loaded = [load_arm(name, check_load=False) for name in arms or ("forearm",)]
    console, points = Console(), list[arm_study.Point]()
    with progress(console, "points", len(loaded) * arm_study.N_POINTS) as done:
        for one in loaded:
            points += (own := arm_study.measure_arm(one, done=done))
            save(arm_study.draw_arm(own), folder / f"accuracy-{one.name.replace(' ', '-')}.svg")
    write_table(folder / "accuracy.csv", points)
    console.table(arm_study.TITLES, arm_study.table(points))
    console.print(f"{len(points)} points in {folder}")


@command.command()
@_out("study-paper")
def paper(folder: Path) -> None:
    """Remake figures 7 to 13 of the paper.

    All levels of the estimator are drawn.

    \b
    Example:
      skinbus study paper --out docs/figures
    """
    from skinbus.study.paper import N_CELLS, make_all

    with extra_wanted("figures"):
        import skinbus.study.draw  # noqa: F401  refused now, not after minutes

    folder.mkdir(parents=True, exist_ok=True)
    console = Console()
    with progress(console, "the paper's figures", N_CELLS) as done:
        make_all(folder, done=done)
    console.print(f"figures and tables are in {folder}")
