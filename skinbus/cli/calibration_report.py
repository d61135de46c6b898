"""The report of a calibration: what was learned, the error to expect, unusual tactels and outliers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.cli.report import Report
from skinbus.estimate.calibration import Calibration, Judgement
from skinbus.model import Radial
from skinbus.study.draw import new_figure

Ints = npt.NDArray[np.intp]

ENLARGED: Final = 10.0
"""By which deviations are drawn over a board: half a millimetre is then half a pitch."""


def write_calibration(
    arm: str, source: str, judged: Sequence[tuple[Judgement, Ints, str]], file: Path
) -> None:
    """Write the report of the boards of an arm.

    Args:
        arm: name of the arm.
        source: name of the file of presses.
        judged: of each kind of board what came of its presses, their lines in the file, the verdict as text.
        file: the page to write.
    """
    report = Report(f"Calibration of {arm}")
    report.paragraph(f"{sum(len(one.table) for one, _, _ in judged)} presses from {source}")
    for one, lines, words in judged:
        table, learned = one.table, one.calibration
        n_tactels = table.arm.patches[0].patch.n_tactels
        report.heading(f"Boards of {n_tactels} tactels{', refused' if one.faults else ''}")
        report.paragraph(words)
        if learned is None:
            continue
        report.figure(_law(one, learned))
        for p in range(table.arm.n_patches):
            report.heading(f"Board {table.arm.node_label(p)}")
            report.figure(_board(one, learned, p))
        if len(one.outliers):
            report.heading("Presses left out: they deviate far more than the others")
            mm = np.round(1e3 * np.stack([table.s, table.a], -1), 1).tolist()
            rows = [(lines[k], table.arm.node_label(int(table.patch[k])), *mm[k]) for k in one.outliers]
            report.table(("line of the file", "node", "s, mm", "a, mm"), rows)
    report.write(file)


def _law(one: Judgement, learned: Calibration) -> Any:
    """Draw the profile of the law, and the errors of presses that were not used."""
    figure, ((profile, places),) = new_figure(2, width=5.0)
    for law, errors, label, colour in (
        (learned.law, one.errors, "learned", "tab:blue"),
        (one.table.arm.patches[0].patch.law, one.shipped, "before", "tab:orange"),
    ):
        if isinstance(law, Radial):
            d, force = np.linspace(0.0, law.step * (len(law.table) - 1), 200), law.typical_force or 1.0
            k = np.asarray(law.pressure(d, force)) / force
            profile.plot(1e3 * d, k / 1e3, color=colour, label=label)
        if errors is not None:
            mm = np.sort(1e3 * np.hypot(*errors.uv[errors.found & one.kept].T))
            places.plot(mm, np.linspace(0.0, 100.0, len(mm)), color=colour, label=label)
    profile.set(xlabel="distance from the press (mm)", ylabel="pressure of 1 N or unit of force (kPa)")
    places.set(xlabel="error of place at presses not used (mm)", ylabel="part of the presses (%)")
    profile.legend()
    return figure


def _board(one: Judgement, learned: Calibration, p: int) -> Any:
    """Draw where presses are found against where they were, and gain, width and noise of the tactels."""
    arm, uv, pressed = one.table.arm, 1e3 * one.table.uv(), one.table.patch == p
    here, tactels = arm.tactels_of(p), 1e3 * arm.patches[p].patch.tactels_uv
    figure, ((residuals, *panels),) = new_figure(4, width=3.4)
    residuals.plot(*uv[pressed & one.kept].T, ".", color="tab:blue")
    residuals.plot(*uv[pressed & ~one.kept].T, "D", color="tab:red")
    if one.errors is not None:
        shown = pressed & one.kept & one.errors.found
        arrows = {"angles": "xy", "scale_units": "xy", "scale": 1.0 / ENLARGED, "color": "tab:blue"}
        residuals.quiver(*uv[shown].T, *(1e3 * one.errors.uv[shown].T), **arrows)
    residuals.set_title(f"residuals, {ENLARGED:g} times as long; red: left out")
    for axes, title, values in zip(
        panels,
        ("gain of each tactel", "width of each tactel", "noise of each tactel (Pa)"),
        (learned.gain[here], learned.width[here], learned.noise[here]),
        strict=True,
    ):
        axes.set_title(title)
        axes.scatter(*tactels.T, c=values, s=400, cmap="coolwarm", alpha=0.6)
        for (u, v), value in zip(tactels, values, strict=True):
            axes.text(u, v, f"{value:.3g}", ha="center", va="center", fontsize=6)
    for axes in (residuals, *panels):
        axes.set(xlabel="u (mm)", ylabel="v (mm)", aspect="equal")
    return figure
