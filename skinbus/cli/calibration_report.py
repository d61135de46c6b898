"""The report of a calibration: what was learned, the error to expect, unusual tactels and outliers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.cli.report import Report
from skinbus.estimate.calibration import Calibration
from skinbus.estimate.presses import Judgement
from skinbus.estimate.presses.cross_validation import USUAL
from skinbus.estimate.response import GAIN_SPREAD, WIDTH_SPREAD
from skinbus.model import Radial
from skinbus.study.draw import new_figure

Ints = npt.NDArray[np.intp]

FAR: Final = 3.0
"""Standard deviations of healthy tactels from which one is named: 3 of 1000 good ones are."""
MANY_NOISE: Final = 3.0
"""Times the median noise of the board from which a tactel is named."""
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
        n_tactels = one.table.arm.patches[0].patch.n_tactels
        refused = ", refused" if one.faults else ""
        report.heading(f"Boards of {n_tactels} tactels{refused}")
        report.paragraph(words)
        if one.calibration is None:
            continue
        report.paragraph(_health(one, one.calibration))
        report.figure(_law(one, one.calibration))
        for p in range(one.table.arm.n_patches):
            report.heading(f"Board {one.table.arm.node_label(p)}")
            report.figure(_board(one, one.calibration, p))
        if len(one.outliers):
            report.heading("Presses left out: they deviate far more than the others")
            titles = ("line of the file", "node", "s, mm", "a, mm", "force, N")
            report.table(titles, list(_outliers(one, lines)))
    report.write(file)


def _health(one: Judgement, learned: Calibration) -> str:
    """Return spreads beside those of healthy boards, and the tactels that are unlike healthy ones."""
    arm, odd = one.table.arm, []
    gain = np.concatenate([_relative_gain(one, learned, p) for p in range(arm.n_patches)])
    for p in range(arm.n_patches):
        here = arm.tactels_of(p)
        for what, is_odd in (
            ("gain", np.abs(_relative_gain(one, learned, p) - 1.0) > FAR * GAIN_SPREAD),
            ("width", np.abs(learned.width[here] - 1.0) > FAR * WIDTH_SPREAD),
            ("noise", learned.noise[here] > MANY_NOISE * np.median(learned.noise[here])),
        ):
            odd += [f"node {arm.node_label(p)} tactel {k + 1} ({what})" for k in np.flatnonzero(is_odd)]
    return (
        f"Spread of gains: {100 * gain.std():.1f} %; of healthy boards about {100 * GAIN_SPREAD:.0f} %.\n"
        f"Spread of widths: {100 * learned.width.std():.1f} %; about {100 * WIDTH_SPREAD:.0f} %.\n"
        f"Noise, median: {np.median(learned.noise):.0f} Pa; declared {np.median(arm.tactel_noise):.0f} Pa.\n"
        + (f"Unlike healthy tactels: {'; '.join(odd)}." if odd else "No tactel is unlike healthy ones.")
    )


def _relative_gain(one: Judgement, learned: Calibration, p: int) -> npt.NDArray[np.float64]:
    """Return the gains of a board over their median."""
    gain = learned.gain[one.table.arm.tactels_of(p)]
    return np.asarray(gain / np.median(gain))


def draw_law(axes: Any, law: Radial, label: str, colour: str) -> None:
    """Draw the profile of a law with its standard deviation."""
    d, force = np.linspace(0.0, law.step * (len(law.table) - 1), 200), law.typical_force or 1.0
    k = np.asarray(law.pressure(d, force)) / force / 1e3
    spread = law.misfit * k
    if law.misfit_profile is not None:
        effective = float(law.pressure(0.0, force)) / float(law.profile(0.0))
        at = law.step * np.arange(len(law.table))
        spread = np.interp(d, at, law.misfit_profile) * effective / force / 1e3
    axes.plot(1e3 * d, k, color=colour, label=label)
    axes.fill_between(1e3 * d, k - spread, k + spread, color=colour, alpha=0.2, lw=0)


def _law(one: Judgement, learned: Calibration) -> Any:
    """Draw the profile of the law, the errors of presses that were not used, and their forces."""
    figure, ((profile, places, forces),) = new_figure(3, width=4.2)
    shipped = one.table.arm.patches[0].patch.law
    draw_law(profile, learned.law, "learned", "tab:blue")
    if isinstance(shipped, Radial):
        draw_law(profile, shipped, "before", "tab:orange")
    profile.set(xlabel="distance from the press (mm)", ylabel="pressure of 1 N or unit of force (kPa)")
    for errors, label, colour in (
        (one.errors, "learned", "tab:blue"),
        (one.shipped, "before", "tab:orange"),
    ):
        if errors is None:
            continue
        found = errors.found & one.kept
        mm = np.sort(1e3 * np.hypot(*errors.uv[found].T))
        within = f"{label}: {100 * USUAL:.0f} % within {1e3 * errors.place(one.kept):.2f} mm"
        places.plot(mm, np.linspace(0.0, 100.0, len(mm)), color=colour, label=within)
        if one.table.force is not None:
            forces.plot(one.table.force[found], errors.force[found], ".", color=colour, label=label)
    places.set(
        xlabel="error of place at presses not used (mm)", ylabel="part of the presses (%)", xlim=(0, None)
    )
    forces.set(xlabel="force of the press (N)", ylabel="force found at presses not used (N)")
    for axes in (profile, places, forces):
        if axes.lines:
            axes.legend(fontsize=7)
    return figure


def _board(one: Judgement, learned: Calibration, p: int) -> Any:
    """Draw where presses are found against where they were, and gain, width and noise of the tactels."""
    arm, uv = one.table.arm, 1e3 * one.table.uv()
    here, patch = arm.tactels_of(p), arm.patches[p].patch
    figure, (panels,) = new_figure(4, width=3.4, height=3.6)
    panels[0].plot(*(1e3 * patch.tactels_uv.T), "o", color="0.85", ms=12)
    pressed = one.table.patch == p
    if one.errors is not None:
        shown = pressed & one.kept & one.errors.found
        arrows = {"angles": "xy", "scale_units": "xy", "scale": 1.0 / ENLARGED, "color": "tab:blue"}
        panels[0].quiver(*uv[shown].T, *(1e3 * one.errors.uv[shown].T), **arrows)
    panels[0].plot(*uv[pressed & one.kept].T, ".", color="tab:blue", ms=3)
    panels[0].plot(*uv[pressed & ~one.kept].T, "D", color="tab:red", ms=5)
    panels[0].set_title(f"residuals, {ENLARGED:g} times as long; red: left out")
    for axes, title, values, form in (
        (panels[1], "gain of each tactel", learned.gain[here], ".3f"),
        (panels[2], "width of each tactel", learned.width[here], ".3f"),
        (panels[3], "noise of each tactel (Pa)", learned.noise[here], ".0f"),
    ):
        axes.scatter(*(1e3 * patch.tactels_uv.T), c=values, s=400, cmap="coolwarm", alpha=0.6)
        for (u, v), value in zip(1e3 * patch.tactels_uv, values, strict=True):
            axes.text(u, v, format(value, form), ha="center", va="center", fontsize=6)
        axes.set_title(title)
    half = 500.0 * max(patch.size)
    for axes in panels:
        axes.set(xlabel="u (mm)", ylabel="v (mm)", aspect="equal", xlim=(-half, half), ylim=(-half, half))
    return figure


def _outliers(one: Judgement, lines: Ints) -> Iterator[tuple[object, ...]]:
    """Yield the presses that were left out, with their lines in the file."""
    pressed = one.table
    for row in one.outliers.tolist():
        force = "" if pressed.force is None else f"{pressed.force[row]:.2f}"
        place = f"{1e3 * pressed.s[row]:.1f}", f"{1e3 * pressed.a[row]:.1f}"
        yield int(lines[row]), pressed.arm.node_label(int(pressed.patch[row])), *place, force
