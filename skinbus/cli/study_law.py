"""`skinbus study law`: the contact law of a skin that is not calibrated, written to EDS files."""

from __future__ import annotations

from pathlib import Path

import click

from skinbus.cli.output import echo


@click.command()
@click.argument(
    "eds",
    nargs=-1,
    required=True,
    type=click.Path(exists=True, dir_okay=False, writable=True, path_type=Path),
)
def law(eds: tuple[Path, ...]) -> None:
    """Learn the radial law of each board under the usual layer of rubber, pressed by fingertips.

    It is written to the defaults of 0x2020 and 0x2021; the shipped files are made so.

    \b
    Example:
      skinbus study law eds/skin-patch*.eds
    """
    from skinbus.study.generic_law import write_generic_law

    for file in eds:
        found = write_generic_law(file)
        echo(
            f"{file}: k(0) {found.table[0]:.0f} 1/m^2, reach {1e3 * float(found.reach(1.0)):.1f} mm, "
            f"misfit {100 * found.misfit:.1f} %"
        )
