"""`skinbus calibrate`: contact law, gains and noise of patches from presses at known places, as DCF files."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt

from skinbus.cli import output
from skinbus.cli.console import Console
from skinbus.cli.options import INPUT, file_option
from skinbus.cli.output import echo
from skinbus.cli.press_csv import read_presses
from skinbus.config.arm_file import find_arm, read_arm_file
from skinbus.config.system import load_arm
from skinbus.estimate.calibration.gate import MAX_ERROR_M, Judgement, judge
from skinbus.estimate.calibration.table import kind_of, tables_of
from skinbus.formatting import counted, span
from skinbus.model import Arm, PlacedPatch
from skinbus.objects.board import calibration_values, describe_patch
from skinbus.objects.dcf import write_dcf
from skinbus.objects.eds import load_eds

Ints = npt.NDArray[np.intp]

GOOD = 0.03
"""Error to expect that is called good, of the pitch: what boards of rubber reach with a hundred presses."""
WORTH = 1.2
"""Ratio of the errors of places from which a law without newtons is worth more than one with them."""
MANY = 10
"""Lines of a file, or runs of them, that are listed."""
BETTER = (
    "for a better one press more (a hundred times a board is plenty), at uneven places, with a round tip and "
    "known forces (`force_n`)"
)
BOARDS = ("node", "presses", "left out", "error mm")


@click.command()
@click.argument("arm")
@click.argument("presses", type=INPUT)
@file_option(
    "--out",
    callback=output.dcf,
    required=True,
    help="The DCF to write; with several patches, each name ends with the node-ID.",
)
@click.option("--force", is_flag=True, help="Write the DCF files in spite of faults.")
@click.option(
    "--all-of-kind",
    is_flag=True,
    help="Also write the law into DCF files of boards of the same kind that were not pressed.",
)
def command(
    arm: str,
    presses: Path,
    out: Path,
    force: bool,
    all_of_kind: bool,
) -> None:
    """Learn the contact law, gains and noise of patches of ARM from the presses in a CSV file.

    A line has the readings of one patch under one press. Columns, in any order:

    \b
      node_id       the patch
      bus           name of its bus, where node-IDs repeat from bus to bus
      s_mm, a_mm    the place pressed, on the chart of its link
      force_n       force, N; 0 where nothing touches: what is read there is the zero.
                    Without it, or empty: not known, but the same in all presses;
                    forces of contacts are then in units of it
      p1, p2, ...   readings in Pa, one per tactel, without the gains of the board; empty: missing.
                    A count is full scale / 32767 (8 bits: 127) Pa
      n1, n2, ...   standard deviation of a single reading, Pa. Without it the noise is at least what
                    the board declares

    Columns are divided by commas. Other columns, such as a time, are ignored. A hundred presses spread over
    a patch and half a pitch around it are plenty. In the arm file `eds` of a patch names the DCF, `eds` of a
    ring a list of them; `skinbus configure` writes it into the board.

    Impossible presses are refused: status 1, and no file is written. The command then tries other units,
    axes and boards, and names those that fit. Otherwise it prints the error to expect, measured at presses
    that were left out of the calibration.

    \b
    Examples:
      skinbus calibrate pad presses.csv --out patch.dcf
      skinbus calibrate forearm presses.csv --out patch.dcf --all-of-kind
    """
    whole, arm_file = load_arm(arm), read_arm_file(find_arm(arm))
    output.keep_files([out, *(file_of(out, whole, p) for p in range(whole.n_patches))], arm, arm_file.files)
    judged, rows = [], []
    for table, lines in tables_of(whole, read_presses(whole, presses)):
        judged.append(one := judge(table))
        echo("\n".join(report(one, lines)), err=bool(one.faults))
        for p in range(table.arm.n_patches):
            mine = table.patch == p
            error = np.nan if one.errors is None else 1e3 * one.errors.place(one.kept & mine)
            rows.append((table.arm.node_label(p), mine.sum(), (mine & ~one.kept).sum(), f"{error:.2f}"))
    Console().table(BOARDS, rows)
    learned = [judgement for judgement in judged if judgement.calibration is not None]
    if any(judgement.faults for judgement in judged) and not (force and learned):
        echo("nothing is written" + ("; --force writes it all the same" if learned else ""), err=True)
        sys.exit(1)
    boards = [board for judgement in learned for board in boards_of(whole, judgement, all_of_kind)]
    for p, own in boards:
        file = out if len(boards) == 1 else file_of(out, whole, p)
        write(whole.patches[p], own, file)
        echo(f"{file}: eds of node {whole.node_label(p)}")


def report(judged: Judgement, lines: Ints) -> Iterator[str]:
    """Yield what was learned, the error to expect, faults, and what to do; ``lines`` are of the file."""
    learned, is_known = judged.calibration, judged.table.force is not None
    n_tactels = judged.table.arm.patches[0].patch.n_tactels
    yield f"boards of {n_tactels} tactels: {counted(len(judged.table), 'press')}"
    if learned is not None:
        law, unit = learned.law, "1 N" if is_known else "these presses"
        yield f"{learned.n_readings} readings used, {'converged' if learned.converged else 'NOT converged'}"
        yield f"law: {law.table[0] / 1e3:.4g} kPa at the peak of {unit}, misfit {100 * law.misfit:.1f} %"
    yield from (f"note: {note}" for note in judged.notes)
    if len(judged.outliers):
        runs = span(lines[judged.outliers].tolist()).split(", ")
        more = " and others" if len(runs) > MANY else ""
        yield f"left out, because they do not go with the others: line {', '.join(runs[:MANY])}{more}"
    place = judged.place_error
    before = np.nan if judged.shipped is None else judged.shipped.place(judged.kept)
    if np.isfinite(place):
        force = f" and {100 * judged.force_error:.1f} % of the force" if is_known else ""
        yield (
            f"error to expect (68 % of presses not used): {1e3 * place:.2f} mm{force}; "
            f"with the law that boards have {1e3 * before:.2f} mm"
        )
    if judged.faults:
        yield "\n  ".join(["refused:", *judged.faults])
    elif before < place * (1.0 if is_known else WORTH):
        units = "" if is_known else " and not in newtons"
        yield (
            f"keep the law that the boards have: at these presses it errs by {1e3 * before:.2f} mm, this one "
            f"by {1e3 * place:.2f} mm{units}; {BETTER}"
        )
    else:
        is_good = place <= GOOD * judged.table.pitch
        grade = "good" if is_good else "fair" if place <= MAX_ERROR_M else "poor"
        yield f"this is {grade}: write it into boards, as `eds` in the arm file and by `skinbus configure`"
        if not is_known:
            yield "forces will not be in newtons: 1 is the force of these presses, which is not known"
        if not (is_known and is_good):
            yield BETTER


def boards_of(whole: Arm, judgement: Judgement, all_of_kind: bool) -> Iterator[tuple[int, dict[str, Any]]]:
    """Return the boards pressed, if wanted the others of their kind, and the response of each."""
    part, learned = judgement.table.arm, judgement.calibration
    assert learned is not None
    pressed = {
        whole.patch_at(placed.node_id, placed.bus): learned.of(part.tactels_of(p))
        for p, placed in enumerate(part.patches)
    }
    yield from pressed.items()
    for p in range(whole.n_patches if all_of_kind else 0):
        if p not in pressed and kind_of(whole, p) == kind_of(part, 0):
            gain = np.array(whole.tactel_gain[whole.tactels_of(p)])
            ones, noise = np.ones_like(gain), np.median(learned.noise)
            yield (
                p,
                {"law": learned.law, "gain": gain, "width": ones, "bias": 0.0 * ones, "noise": noise * ones},
            )


def file_of(out: Path, whole: Arm, p: int) -> Path:
    """Return the file of one of several boards: with the node-ID, and the bus if there are several."""
    return out.with_stem(f"{out.stem}-{whole.node_label(p)}".replace(" ", "-"))


def write(placed: PlacedPatch, response: dict[str, Any], file: Path) -> None:
    """Write the DCF of a board."""
    od, learned = load_eds(placed.eds, placed.node_id), response.get("residual_map")
    if learned is not None and not np.allclose(describe_patch(od).tactels_uv, placed.patch.tactels_uv):
        response["residual_map"] = learned.mirrored()  # the file is of the board, whichever way it is mounted
    write_dcf(placed.eds, file, calibration_values(od, **response), node_id=placed.node_id)
