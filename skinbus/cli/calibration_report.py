"""What a calibration came to: the law, the boards side by side, whether it is good."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.cli.formatting import counted, span
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
BOARDS: Final = ("node", "presses", "left out", "gain", "spread %", "noise Pa", "error mm")


def report(judged: Judgement) -> str:
    """Return what was learned."""
    learned, presses = judged.calibration, counted(len(judged.table), "press")
    if learned is None:
        return f"{presses}, nothing learned"
    law, converged = learned.law, "converged" if learned.converged else "NOT converged"
    unit = "these presses" if judged.table.force is None else "1 N"
    return (
        f"{presses}, {learned.n_readings} readings used, {converged}\n"
        f"law: {law.table[0] / 1e3:.4g} kPa at the peak of {unit}, reach "
        f"{1e3 * law.step * (len(law.table) - 1):.1f} mm, pressure as force^{law.exponent:.3f}\n"
        f"misfit of the law {100 * law.misfit:.1f} %, residual {learned.residual:.2f} (1: noise)"
    )


def verdict(judged: Judgement, lines: Ints) -> str:
    """Return the error to expect, what was found, whether it is good; ``lines`` are those of the file."""
    said = [f"note: {_sentence(finding, lines)}" for finding in judged.notes]
    place, is_known = judged.place_error, judged.table.force is not None
    before = np.nan if judged.shipped is None else judged.shipped.place(judged.kept)
    if np.isfinite(place):
        force = f" and {100 * judged.force_error:.1f} % of the force" if is_known else ""
        said.append(
            f"error to expect (68 % of presses not used): {1e3 * place:.2f} mm{force}; "
            f"with the law that boards have {1e3 * before:.2f} mm"
        )
    if judged.faults:
        said += ["refused:", *(f"  {_sentence(finding, lines)}" for finding in judged.faults)]
        if judged.is_shifted:
            said.append(
                "  if the places of the presses are true, `skinbus calibrate locate` finds the boards"
            )
    elif before * (SAME if is_known else 1.0 / WORTH) < place:
        said.append(
            f"keep the law that the boards have: at these presses it errs by {1e3 * before:.2f} mm, this one "
            f"by {1e3 * place:.2f} mm{'' if is_known else ' and not in newtons'}; {BETTER}"
        )
    else:
        grade = "good" if judged.is_good else "fair" if place <= MAX_ERROR_M else "poor"
        said.append(
            f"this is {grade}: write it into the boards, as `eds` in the arm file and by `skinbus configure`"
        )
        if not is_known:
            said.append("forces will not be in newtons: 1 is the force of these presses, which is not known")
        if not (is_known and judged.is_good):
            said.append(BETTER)
    return "\n".join(said)


def _sentence(finding: GateFinding, lines: Ints) -> str:
    """Return a finding with the lines of the file that it is about."""
    if not finding.rows:
        return finding.what
    runs = span(lines[list(finding.rows)].tolist()).split(", ")
    more = " and others" if len(runs) > MANY else ""
    return f"{finding.what}: line{'s' if len(finding.rows) > 1 else ''} {', '.join(runs[:MANY])}{more}"


def board_rows(judged: Judgement) -> Iterator[Sequence[object]]:
    """Return a row of BOARDS for each board of a kind."""
    arm, learned = judged.table.arm, judged.calibration
    for p in range(arm.n_patches):
        here, mine = arm.tactels_of(p), judged.table.patch == p
        gain, noise = (
            (np.full(1, np.nan),) * 2 if learned is None else (learned.gain[here], learned.noise[here])
        )
        error = np.nan if judged.errors is None else 1e3 * judged.errors.place(judged.kept & mine)
        yield (
            arm.node_label(p), mine.sum(), (mine & ~judged.kept).sum(), f"{gain.mean():.3f}",
            f"{100 * gain.std() / gain.mean():.1f}", f"{np.median(noise):.0f}", f"{error:.2f}",
        )  # fmt: skip
