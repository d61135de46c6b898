"""What a calibration came to, as text: the law, the boards side by side, and whether it is good."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from skinbus.cli.formatting import counted, span
from skinbus.config.arm_file import find_arm, read_arm_file
from skinbus.estimate.presses import Finding, Judgement
from skinbus.estimate.presses.gate import GOOD, MAX_ERROR_M, pitch
from skinbus.model import PlacedPatch

Ints = npt.NDArray[np.intp]

MANY = 10
"""Lines of a file that are listed."""


def report(judged: Judgement) -> str:
    """Return what was learned."""
    learned = judged.calibration
    if learned is None:
        return f"{counted(len(judged.table), 'press')}, nothing learned"
    law, gain = learned.law, learned.gain
    reach = law.step * (len(law.table) - 1)
    return "\n".join(
        [
            f"{counted(len(judged.table), 'press')}, {learned.n_readings} readings used, "
            + ("converged" if learned.converged else "NOT converged"),
            f"law: {law.table[0] / 1e3:.4g} kPa at the peak of 1 N, reach {1e3 * reach:.1f} mm, "
            f"pressure as force^{law.exponent:.3f}",
            f"misfit of the law {100 * law.misfit:.1f} %, residual {learned.residual:.2f} (1: noise)",
            f"gains {gain.min():.3f} to {gain.max():.3f}, spread {100 * gain.std() / gain.mean():.1f} %",
            f"widths {learned.width.min():.3f} to {learned.width.max():.3f}, residuals "
            + ("mapped" if learned.residual_map is not None else "not mapped: no map predicts other presses"),
            f"noise {np.median(learned.noise):.0f} Pa (median of {counted(len(gain), 'tactel')})",
            *(
                ["the force is not known: forces of contacts are then in units of that of the presses"]
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
            f"with the law that boards have {1e3 * judged.shipped.place(judged.kept):.2f} mm"
        ]
    if judged.faults:
        if any(pose.fault for pose in judged.poses):
            found.append(
                "  if the places of the presses are true, `skinbus locate` finds where the boards are"
            )
        return "\n".join([*notes, *expected, "refused:", *found])
    good = judged.place_error <= GOOD * pitch(judged.table)
    return "\n".join([*notes, *expected, "this is good" if good else _advice(judged)])


def sentence(finding: Finding, lines: Ints) -> str:
    """Return a finding with the lines of the file that it speaks of."""
    if not finding.rows:
        return finding.what
    of = lines[list(finding.rows)]
    if len(of) > MANY and np.ptp(of) + 1 > len(of):
        where = f"{', '.join(map(str, of[:MANY]))} and {len(of) - MANY} more"
    else:
        where = span(of.tolist())
    return f"{finding.what}: {'line' if len(of) == 1 else 'lines'} {where}"


def _advice(judged: Judgement) -> str:
    """Return what would make a calibration better that is not good."""
    grade = "fair" if judged.place_error <= MAX_ERROR_M else "poor"
    each = len(judged.table) / judged.table.arm.n_patches
    assert judged.errors is not None
    if each < 80.0:
        return (
            f"this is {grade}; more presses would make it better: {each:.0f} on a board, a hundred are plenty"
        )
    if judged.errors.misfit > 0.05:
        return (
            f"this is {grade}; the readings differ by {100 * judged.errors.misfit:.0f} % from the law: "
            "places or forces of the presses may be less true than those of other set-ups, or the tip is "
            "not round"
        )
    return f"this is {grade}; readings of less noise, as means over many cycles, would make it better"


def side_by_side(judged: Sequence[Judgement]) -> str:
    """Return a table of the boards, one in a line."""
    rows: list[tuple[str, ...]] = [
        ("node", "presses", "left out", "gain", "spread %", "noise Pa", "error mm")
    ]
    for judgement in judged:
        table, learned = judgement.table, judgement.calibration
        out = np.zeros(len(table), np.bool_)
        out[judgement.outliers] = True
        for p, placed in enumerate(table.arm.patches):
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
            rows.append((str(placed.node_id), str(mine.sum()), str((out & mine).sum()), *cells))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def arm_file_lines(arm: str, written: Sequence[tuple[PlacedPatch, Path]]) -> str:
    """Return what the arm file takes: a line for each patch, and one list for each ring."""
    mountings = read_arm_file(find_arm(arm)).mountings
    keys = {(mounting.bus, mounting.node_id): mounting for mounting in mountings}
    files = {keys[placed.bus, placed.node_id].key: str(file) for placed, file in written}
    text, rings = [], []
    for placed, file in written:
        mounting = keys[placed.bus, placed.node_id]
        ring = re.fullmatch(r"(ring\[\d+\])#\d+", mounting.key)
        if ring is None:
            text.append(f'node {placed.node_id}: eds = "{file}" in its [[patch]]')
        elif ring[1] not in rings:
            rings.append(ring[1])
            every = [m for m in mountings if m.key.startswith(f"{ring[1]}#")]
            quoted = ", ".join(f'"{files.get(m.key, m.eds)}"' for m in every)
            text.append(f"{ring[1]}: eds = [{quoted}] in that [[ring]]")
    return "\n".join(text)
