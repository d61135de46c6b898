"""What a calibration came to, as text: the law, the boards side by side, and whether it is good."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from skinbus.cli.formatting import counted, span
from skinbus.config.placement import Mounting
from skinbus.estimate.presses import GateFinding, Judgement
from skinbus.estimate.presses.gate import GOOD_FORCE, MAX_ERROR_M, SAME
from skinbus.estimate.presses.spread import UNEVEN, gaps_of
from skinbus.model import Arm, PlacedPatch

Ints = npt.NDArray[np.intp]

WORTH = 1.2
"""Ratio of the errors of places from which a law without newtons is worth more than one with them."""
MANY = 10
"""Lines of a file that are listed."""


def report(judged: Judgement) -> str:
    """Return what was learned."""
    learned = judged.calibration
    if learned is None:
        return f"{counted(len(judged.table), 'press')}, nothing learned"
    law, gain = learned.law, learned.gain
    reach = law.step * (len(law.table) - 1)
    unit = "1 N" if judged.table.force is not None else "these presses"
    return "\n".join(
        [
            f"{counted(len(judged.table), 'press')}, {learned.n_readings} readings used, "
            + ("converged" if learned.converged else "NOT converged"),
            f"law: {law.table[0] / 1e3:.4g} kPa at the peak of {unit}, reach {1e3 * reach:.1f} mm, "
            f"pressure as force^{law.exponent:.3f}",
            f"misfit of the law {100 * law.misfit:.1f} %, residual {learned.residual:.2f} (1: noise)",
            f"gains {gain.min():.3f} to {gain.max():.3f}, spread {100 * gain.std() / gain.mean():.1f} %",
            f"widths {learned.width.min():.3f} to {learned.width.max():.3f}, residuals "
            + ("mapped" if learned.residual_map is not None else "not mapped: no map predicts other presses"),
            f"noise {np.median(learned.noise):.0f} Pa (median of {counted(len(gain), 'tactel')})",
            *(
                ["the force is not known: 1 is the force of these presses, not 1 N"]
                if judged.table.force is None
                else []
            ),
        ]
    )


def verdict(judged: Judgement, lines: Ints) -> str:
    """Return the error to expect, what was found, whether it is good; ``lines`` are those of the file."""
    found = [f"  {sentence(finding, lines)}" for finding in judged.faults]
    notes = [f"note: {sentence(finding, lines)}" for finding in judged.notes]
    expected = []
    if judged.errors is not None and judged.shipped is not None and np.isfinite(judged.place_error):
        force = "" if judged.table.force is None else f" and {100 * judged.force_error:.1f} % of the force"
        expected = [
            f"error to expect (68 % of presses not used): {1e3 * judged.place_error:.2f} mm{force}; "
            f"with the law that boards have {1e3 * before_error(judged):.2f} mm"
        ]
    if judged.faults:
        if any(pose.fault for pose in judged.poses):
            found.append(
                "  if the places of the presses are true, `skinbus calibrate locate` finds the boards"
            )
        return "\n".join([*notes, *expected, "refused:", *found])
    return "\n".join([*notes, *expected, _what_to_do(judged)])


def sentence(finding: GateFinding, lines: Ints) -> str:
    """Return a finding with the lines of the file that it is about."""
    if not finding.rows:
        return finding.what
    of = lines[list(finding.rows)]
    if len(of) > MANY and np.ptp(of) + 1 > len(of):
        where = f"{', '.join(map(str, of[:MANY]))} and {len(of) - MANY} more"
    else:
        where = span(of.tolist())
    return f"{finding.what}: {'line' if len(of) == 1 else 'lines'} {where}"


def before_error(judged: Judgement) -> float:
    """Return the error of places by the law that the boards had, m."""
    return math.nan if judged.shipped is None else judged.shipped.place(judged.kept)


def is_truer(judged: Judgement) -> bool:
    """Whether places are at least as true as by the law that the boards had."""
    return not judged.place_error > SAME * before_error(judged)


def _what_to_do(judged: Judgement) -> str:
    """Return whether to use a calibration, and what would make it better."""
    place, before = judged.place_error, before_error(judged)
    in_newtons = "press with known forces (`force_n`)"
    if not is_truer(judged):
        truer = f"at these presses it errs by {1e3 * before:.2f} mm, this one by {1e3 * place:.2f} mm"
        then = _better(judged) if judged.table.force is not None else in_newtons
        return f"keep the law that the boards have: {truer}; for a better one {then}"
    if judged.table.force is None and before <= WORTH * place:
        return (
            f"keep the law that the boards have: its places are as true ({1e3 * before:.2f} mm, this one "
            f"{1e3 * place:.2f} mm) and its forces are in newtons; for a better one {in_newtons}"
        )
    good = judged.is_good
    grade = "good" if good else "fair" if place <= MAX_ERROR_M else "poor"
    use = (
        f"this is {grade}: write it into the boards, as `eds` in the arm file and by `skinbus configure`\n"
        "it is truest for what these presses were made with: other sizes are found out by the readings, or "
        "are in the covariance (docs/estimator.md)"
    )
    if judged.table.force is None:
        return (
            f"{use}\nforces will not be in newtons: 1 is the force of these presses, whatever it was, and "
            f"replaces the scale of the law in the EDS; for forces in newtons {in_newtons}"
        )
    return use if good else f"{use}\nfor a better one {_better(judged)}"


def _better(judged: Judgement) -> str:
    """Return what would make a calibration better."""
    each = len(judged.table) / judged.table.arm.n_patches
    assert judged.errors is not None
    if gaps_of(judged.table):
        return UNEVEN
    if each < 80.0:
        return f"make more presses: {each:.0f} on a board, a hundred are plenty"
    if judged.table.force is not None and judged.force_error > GOOD_FORCE:
        differ = f"{100 * judged.force_error:.0f} %"
        return f"measure the forces again: they differ by {differ} from what the readings say"
    if judged.errors.misfit > 0.05:
        return (
            "look at places and forces of the presses, and whether the tip is round: the readings differ by "
            f"{100 * judged.errors.misfit:.0f} % from the law"
        )
    if judged.calibration is not None and not judged.calibration.converged:
        return "make presses at other places, too: the law still changed when learning ended"
    return "take readings of less noise, as means over many cycles"


def side_by_side(judged: Sequence[Judgement]) -> str:
    """Return a table of the boards, one in a line."""
    rows: list[tuple[str, ...]] = [
        ("node", "presses", "left out", "gain", "spread %", "noise Pa", "error mm")
    ]
    for judgement in judged:
        table, learned = judgement.table, judgement.calibration
        out = np.zeros(len(table), np.bool_)
        out[judgement.outliers] = True
        for p in range(table.arm.n_patches):
            here, mine = table.arm.tactels_of(p), table.patch == p
            cells = ["-"] * 4
            if learned is not None:
                gain = learned.gain[here]
                cells[:3] = [
                    f"{gain.mean():.3f}",
                    f"{100 * gain.std() / gain.mean():.1f}",
                    f"{np.median(learned.noise[here]):.0f}",
                ]
            if judgement.errors is not None:
                cells[3] = f"{1e3 * judgement.errors.place(judgement.kept & mine):.2f}"
            rows.append((table.arm.node_label(p), str(mine.sum()), str((out & mine).sum()), *cells))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def arm_file_lines(
    mountings: Sequence[Mounting], whole: Arm, written: Sequence[tuple[PlacedPatch, Path]]
) -> str:
    """Return what the arm file with these mountings takes: a line for each patch, one list for each ring."""
    keys = {(mounting.bus, mounting.node_id): mounting for mounting in mountings}
    files = {keys[placed.bus, placed.node_id].key: str(file) for placed, file in written}
    text, rings = [], []
    for placed, file in written:
        mounting = keys[placed.bus, placed.node_id]
        ring = re.fullmatch(r"(ring\[\d+\])#\d+", mounting.key)
        if ring is None:
            node = whole.node_label(whole.patch_at(placed.node_id, placed.bus))
            text.append(f'node {node}: eds = "{file}" in its [[patch]]')
        elif ring[1] not in rings:
            rings.append(ring[1])
            every = [m for m in mountings if m.key.startswith(f"{ring[1]}#")]
            quoted = ", ".join(f'"{files.get(m.key, m.eds)}"' for m in every)
            text.append(f"{ring[1]}: eds = [{quoted}] in that [[ring]]")
    return "\n".join(text)
