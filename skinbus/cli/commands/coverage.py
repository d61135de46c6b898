"""`skinbus plan coverage`: what the skin of an arm feels where, and what it leaves blind."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from skinbus.cli import output
from skinbus.cli.console import WIDE, Console
from skinbus.cli.options import Range, file_option
from skinbus.errors import extra_wanted

if TYPE_CHECKING:
    from skinbus.planning.coverage import Coverage

COLUMNS = {
    "least_force_n": ("least_force", 1.0),
    "sd_place_mm": ("sd_place", 1e3),
    "sd_force_n": ("sd_force", 1.0),
}
"""Column of the coverage, and the factor to the unit."""
TITLES = (
    "link", "area_cm2", "on_boards_cm2", "blind_cm2", *COLUMNS, "bound_holds_pct",
)  # fmt: skip
NOTE = (
    "blind is what registers no touch of any force, the figure shows where; forces and "
    "standard deviations are median and worst on the boards; level full reaches them where the bound holds"
)


@click.command()
@click.argument("arm")
@click.option("--force-n", "force", default=5.0, type=Range(0.01, 1000.0), help="Of the contact, N.")
@file_option("--figure", callback=output.svg, help="Draw the links unrolled (.svg).")
def command(arm: str, force: float, figure: Path | None) -> None:
    """Compute how well each point of ARM (a name or a TOML file) is felt, before a board is ordered.

    For each point of a grid of 2 mm: the least force that is registered, and the Cramer-Rao bound on the
    standard deviation of place and force of a contact, from the laws, noises and thresholds in the files of
    the boards. Level full reaches the bound where four tactels feel the contact; the share of such points is
    printed.

    \b
    Examples:
      skinbus plan coverage forearm
      skinbus plan coverage my-arm.toml --figure skin.svg
    """
    from skinbus.config.system import load_arm
    from skinbus.planning.coverage import cover

    console = Console(width=WIDE)
    with console.status("computing ..."):
        links = cover(load_arm(arm, check_load=False), force=force)
    console.table(TITLES, map(_row, links))
    console.print(f"{arm}: a contact of {force:g} N; {NOTE}")
    if figure:
        with extra_wanted("figures"):
            _draw(links, figure)
        console.print(f"wrote {figure}")


def _row(link: Coverage) -> tuple[str, ...]:
    """Return what a link has: areas, and spreads on the boards."""
    import numpy as np

    on, blind = link.board >= 0, np.isinf(link.least_force)
    areas = [f"{1e4 * link.area[points].sum():.3g}" for points in (slice(None), on, blind)]
    if not on.any():
        return link.link, *areas, *["none"] * (len(COLUMNS) + 1)
    columns = [unit * getattr(link, name)[on] for name, unit in COLUMNS.values()]
    ends = ["{:.3g}, {:.3g}".format(*np.quantile(own, (0.5, 1.0), method="lower")) for own in columns]
    return link.link, *areas, *ends, f"{100 * link.holds[on].mean():.3g}"


def _draw(links: list[Coverage], file: Path) -> None:
    """Draw the links unrolled."""
    import numpy as np

    from skinbus.study.draw import new_figure, save

    figure, panels = new_figure(len(COLUMNS), len(links), width=4.5)
    for link, panel in zip(links, panels, strict=True):
        half, length = 500.0 * link.step[1] * link.a.shape[1], 1e3 * link.step[0] * len(link.s)
        for axes, (name, (column, unit)) in zip(panel, COLUMNS.items(), strict=True):
            values = np.ma.masked_invalid(unit * getattr(link, column))
            extent = (-half, half, 0.0, length)
            picture = axes.imshow(values, norm="log", aspect="equal", origin="lower", extent=extent)
            figure.colorbar(picture, ax=axes, label=name)
            axes.set(title=link.link, xlabel="a (mm)", ylabel="s (mm)")
    save(figure, file)
