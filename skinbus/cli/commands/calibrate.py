"""`skinbus calibrate`: contact law, gains and noise of patches from presses at known places, as DCF files."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt

from skinbus.cli import output
from skinbus.cli.formatting import counted
from skinbus.cli.output import echo
from skinbus.cli.press_csv import Press, read_presses
from skinbus.config.system import load_arm
from skinbus.errors import ConfigError, Fault, SkinbusError
from skinbus.estimate import Calibration, learn_radial_law
from skinbus.model import Arm
from skinbus.objects.board import calibration_values
from skinbus.objects.dcf import write_dcf
from skinbus.objects.eds import load_eds


@click.command()
@click.argument("arm")
@click.argument("presses", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    callback=output.dcf,
    required=True,
    help="The DCF to write; of several patches, each gets one with its node-ID behind the name.",
)
@click.option(
    "--picture",
    type=click.Path(file_okay=False, writable=True, path_type=Path),
    help="Draw the profile into this folder, as calibration.png and .svg.",
)
def command(arm: str, presses: Path, out: Path, picture: Path | None) -> None:
    """Learn the contact law, gains and noise of patches of ARM from the presses in a CSV file.

    One line is what one patch reads under one press. Columns, in any order:

    \b
      node_id       the patch
      s_mm, a_mm    the place pressed, on the chart of its link
      force_n       force, N; 0 where nothing touches: what is read there is the zero.
                    Without it, or empty: not known, but the same in all presses;
                    forces of contacts are then in units of it
      c1, c2, ...   readings as they are on the wire, one per tactel; empty: missing
      p1, p2, ...   or the same in Pa

    Others, such as a time, are left alone. A hundred presses spread over a patch and a centimetre around it
    are plenty. A patch of the arm file takes its DCF as `eds`; `skinbus configure` writes it into the board.
    Status 1 when the learning did not converge: look for wrong places.

    \b
    Examples:
      skinbus calibrate pad presses.csv --out patch.dcf
      skinbus calibrate forearm presses.csv --out patch.dcf --picture pictures
    """
    whole = load_arm(arm)
    read = read_presses(whole, presses)
    pressed = sorted({press.patch for press in read})
    part = Arm(whole.name, whole.links, [whole.patches[p] for p in pressed], *whole.buses)
    is_known = not math.isnan(read[0].force)
    try:
        learned = learn_radial_law(
            part,
            [press.s for press in read],
            [press.a for press in read],
            [press.force for press in read] if is_known else None,
            table_of(part, pressed, read),
            link=whole.patch_link[[press.patch for press in read]],
        )
    except ValueError as error:
        raise ConfigError(str(presses), [Fault("presses", None, f"some to learn from: {error}")]) from None
    echo(report(learned, len(read)))
    if not is_known:
        echo("the force is not known: forces of contacts will be in units of that of the presses")
    for file, node_id in write_files(part, learned, out):
        echo(f'node {node_id}: eds = "{file}" in its [[patch]]')
    if picture:
        draw(learned, picture)
    if not learned.converged:
        echo("it did not converge: are the places and forces right?", err=True)
        sys.exit(1)


def table_of(part: Arm, pressed: list[int], presses: list[Press]) -> npt.NDArray[np.float64]:
    """Return the readings as (n_presses, n_tactels) Pa of the patches pressed; NaN where another was read."""
    table = np.full((len(presses), part.n_tactels), np.nan)
    for row, press in zip(table, presses, strict=True):
        row[part.tactels_of(pressed.index(press.patch))] = press.readings
    return table


def write_files(part: Arm, learned: Calibration, out: Path) -> list[tuple[Path, int]]:
    """Write the DCF of every patch; return each with its node-ID."""
    files = []
    for p, placed in enumerate(part.patches):
        here = part.tactels_of(p)
        od = load_eds(placed.eds, placed.node_id)
        own = learned.residual_map
        values = calibration_values(
            od,
            law=learned.law,
            gain=learned.gain[here],
            noise=learned.noise[here],
            width=learned.width[here],
            bias=learned.bias[here],
            residual_map=None if own is None else replace(own, values=own.values[here]),
        )
        bus = part.buses[placed.bus].name if len(part.buses) > 1 else ""
        label = f"-{bus}-{placed.node_id}" if bus else f"-{placed.node_id}"
        file = out if part.n_patches == 1 else out.with_stem(out.stem + label)
        write_dcf(placed.eds, file, values, node_id=placed.node_id)
        files.append((file, placed.node_id))
    return files


def report(learned: Calibration, n_presses: int) -> str:
    """Return what was learned, as text."""
    law, gain = learned.law, learned.gain
    reach = law.step * (len(law.table) - 1)
    return "\n".join(
        [
            f"{counted(n_presses, 'press')}, {learned.n_readings} readings used, "
            + ("converged" if learned.converged else "NOT converged"),
            f"law: {law.table[0] / 1e3:.4g} kPa at the peak of 1 N, reach {1e3 * reach:.1f} mm, "
            f"pressure as force^{law.exponent:.3f}",
            f"misfit of the law {100 * law.misfit:.1f} %, residual {learned.residual:.2f} (1: noise)",
            f"gains {gain.min():.3f} to {gain.max():.3f}, spread {100 * gain.std() / gain.mean():.1f} %",
            f"widths {learned.width.min():.3f} to {learned.width.max():.3f}, residuals "
            + ("mapped" if learned.residual_map is not None else "not mapped: no map predicts other presses"),
            *outliers(learned),
            f"noise {np.median(learned.noise):.0f} Pa (median of {counted(len(gain), 'tactel')})",
        ]
    )


def outliers(learned: Calibration) -> list[str]:
    """Return a line that lists the presses that were left out, if any were."""
    if not len(learned.outliers):
        return []
    rows = ", ".join(str(row + 1) for row in learned.outliers[:10])
    more = f" and {len(learned.outliers) - 10} more" if len(learned.outliers) > 10 else ""
    return [f"left out, deviating far more than the others: press {rows}{more} (in the order of the file)"]


def draw(learned: Calibration, folder: Path) -> None:
    """Draw the profile of the law into a folder."""
    try:
        from skinbus.study.draw import new_figure, save
    except ImportError:
        raise SkinbusError("pictures need matplotlib: pip install 'skinbus[figures]'") from None

    d = np.linspace(0.0, learned.law.step * (len(learned.law.table) - 1), 400)
    figure, axes = new_figure()
    axes[0, 0].plot(1e3 * d, learned.law.profile(d) / 1e3)
    axes[0, 0].set(xlabel="distance from the contact, mm", ylabel="pressure of 1 N, kPa")
    for file in save(figure, folder, "calibration"):
        echo(f"picture: {file}")
