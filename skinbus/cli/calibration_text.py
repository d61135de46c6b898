"""What a calibration came to, as text: the law, the boards side by side, and whether it is good."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from rich.table import Table

from skinbus.cli.formatting import counted, span
from skinbus.config.placement import Mounting
from skinbus.estimate.calibration import GateFinding, Judgement
from skinbus.estimate.calibration.gate import MAX_ERROR_M, SAME

Ints = npt.NDArray[np.intp]

WORTH: Final = 1.2
"""Ratio of the errors of places from which a law without newtons is worth more than one with them."""
MANY: Final = 10
"""Lines of a file, or runs of them, that are listed."""
BETTER: Final = (
    "for a better one press more (a hundred times a board is plenty), at uneven places, with a round tip and "
    "known forces (`force_n`)"
)


def report(judged: Judgement) -> str:
    """Return what was learned."""
    learned, presses = judged.calibration, counted(len(judged.table), "press")
    if learned is None:
        return f"{presses}, nothing learned"
    law = learned.law
    unit = "these presses" if judged.table.force is None else "1 N"
    converged = "converged" if learned.converged else "NOT converged"
    return "\n".join(
        [
            f"{presses}, {learned.n_readings} readings used, {converged}",
            f"law: {law.table[0] / 1e3:.4g} kPa at the peak of {unit}, reach "
            f"{1e3 * law.step * (len(law.table) - 1):.1f} mm, pressure as force^{law.exponent:.3f}",
            f"misfit of the law {100 * law.misfit:.1f} %, residual {learned.residual:.2f} (1: noise)",
        ]
    )


def verdict(judged: Judgement, lines: Ints) -> str:
    """Return the error to expect, what was found, whether it is good; ``lines`` are those of the file."""
    said = [f"note: {sentence(finding, lines)}" for finding in judged.notes]
    if np.isfinite(judged.place_error):
        force = "" if judged.table.force is None else f" and {100 * judged.force_error:.1f} % of the force"
        said.append(
            f"error to expect (68 % of presses not used): {1e3 * judged.place_error:.2f} mm{force}; "
            f"with the law that boards have {1e3 * before_error(judged):.2f} mm"
        )
    if not judged.faults:
        return "\n".join([*said, *_advice(judged)])
    said += ["refused:", *(f"  {sentence(finding, lines)}" for finding in judged.faults)]
    if judged.is_shifted:
        said.append("  if the places of the presses are true, `skinbus calibrate locate` finds the boards")
    return "\n".join(said)


def sentence(finding: GateFinding, lines: Ints) -> str:
    """Return a finding with the lines of the file that it is about."""
    if not finding.rows:
        return finding.what
    runs = span(lines[list(finding.rows)].tolist()).split(", ")
    more = " and others" if len(runs) > MANY else ""
    return f"{finding.what}: line{'s' if len(finding.rows) > 1 else ''} {', '.join(runs[:MANY])}{more}"


def before_error(judged: Judgement) -> float:
    """Return the error of places by the law that the boards had, m; NaN if it is not known."""
    return np.nan if judged.shipped is None else judged.shipped.place(judged.kept)


def _advice(judged: Judgement) -> Iterator[str]:
    """Return whether to use a calibration, and what would make it better."""
    place, before, is_known = judged.place_error, before_error(judged), judged.table.force is not None
    if before * (SAME if is_known else 1.0 / WORTH) < place:
        yield (
            f"keep the law that the boards have: at these presses it errs by {1e3 * before:.2f} mm, this one "
            f"by {1e3 * place:.2f} mm{'' if is_known else ' and not in newtons'}; {BETTER}"
        )
        return
    grade = "good" if judged.is_good else "fair" if place <= MAX_ERROR_M else "poor"
    yield f"this is {grade}: write it into the boards, as `eds` in the arm file and by `skinbus configure`"
    if not is_known:
        yield "forces will not be in newtons: 1 is the force of these presses, which is not known"
    if not (is_known and judged.is_good):
        yield BETTER


def side_by_side(judged: Sequence[Judgement]) -> Table:
    """Return a table of the boards, one in a line."""
    table = Table(box=None)
    for name in ("node", "presses", "left out", "gain", "spread %", "noise Pa", "error mm"):
        table.add_column(name, justify="right")
    for one in judged:
        for p in range(one.table.arm.n_patches):
            here, mine, learned = one.table.arm.tactels_of(p), one.table.patch == p, one.calibration
            numbers = [f"{mine.sum()}", f"{(mine & ~one.kept).sum()}"]
            if learned is not None:
                gain, noise = learned.gain[here], np.median(learned.noise[here])
                numbers += [f"{gain.mean():.3f}", f"{100 * gain.std() / gain.mean():.1f}", f"{noise:.0f}"]
            if one.errors is not None:
                numbers.append(f"{1e3 * one.errors.place(one.kept & mine):.2f}")
            table.add_row(one.table.arm.node_label(p), *numbers)
    return table


def arm_file_lines(mountings: Sequence[Mounting], written: Mapping[tuple[int, int], Path]) -> Iterator[str]:
    """Return what the tables of the arm file take, by the files written for (bus, node-ID)."""
    tables: dict[str, list[Mounting]] = {}
    for mounting in mountings:
        tables.setdefault(mounting.key.partition("#")[0], []).append(mounting)
    for key, own in tables.items():
        if any((m.bus, m.node_id) in written for m in own):
            files = ", ".join(f'"{written.get((m.bus, m.node_id), m.eds)}"' for m in own)
            yield f"{key}: eds = [{files}]" if "#" in own[0].key else f"{key}: eds = {files}"
