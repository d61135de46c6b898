"""The paper's figures 7 to 13 drawn, the levels side by side, and the null zone beside its formula."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm

from skinbus.estimate import LEVELS
from skinbus.study.draw import COLOURS, MARKERS, new_figure, save
from skinbus.study.paper import (
    EDGE,
    FORCES,
    PER_SIDE,
    SLOPES,
    LevelErrors,
    NullZone,
    Progress,
    figure_13,
    figures_7_8,
    figures_9_10,
    figures_11_12,
    null_zone,
)


def make_all(folder: Path, *, trials: int, seed: int = 0, done: Progress = lambda n: None) -> list[Path]:
    """Run the paper's experiments and write tables (CSV) and figures (PNG, SVG); return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    density = figures_7_8(trials=trials, seed=seed, done=done)
    force = figures_9_10(trials=trials, seed=seed, done=done)
    slope = figures_11_12(trials=trials, seed=seed, done=done)
    surface = figure_13(trials=trials, seed=seed, done=done)
    zones = [null_zone(EDGE / side) for side in PER_SIDE]
    files = []
    for rows, name, label, of in (
        (density, "density", "pitch of the tactels (mm)", lambda e: 1e3 * e.pitch),
        (force, "force", "force (N)", lambda e: e.force),
        (slope, "drop-off", "drop-off rate (MPa/m)", lambda e: 1e-6 * e.slope),
    ):
        first = {"density": 7, "force": 9, "drop-off": 11}[name]
        files += _curves(folder, f"paper-fig{first:02d}-force-error-{name}", rows, label, of, "force_pct")
        files += _curves(
            folder, f"paper-fig{first + 1:02d}-position-error-{name}", rows, label, of, "position_mm"
        )
    files += _surface(folder, "paper-fig13-position-error-force-and-drop-off", surface)
    files += _zones(folder, "paper-null-zone", zones)
    files.append(write_table(folder / "paper.csv", [*density, *force, *slope, *surface]))
    files.append(write_table(folder / "paper-null-zone.csv", zones))
    return files


def _curves(
    folder: Path,
    name: str,
    rows: Sequence[LevelErrors],
    label: str,
    of: Callable[[LevelErrors], float],
    column: str,
) -> list[Path]:
    """Draw means of one column: one touch as a line, two as a dashed one."""
    figure, ((axes,),) = new_figure()
    for level in LEVELS:
        for n, dash in ((1, "-"), (2, "--")):
            own = [e for e in rows if e.level == level and e.n_touches == n]
            axes.plot(
                [of(e) for e in own],
                [_value(e, column) for e in own],
                dash,
                color=COLOURS[level],
                marker=MARKERS[level],
                ms=3.5,
                label=f"{level}, {n} touch{'es' if n > 1 else ''}",
            )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(label)
    axes.set_ylabel({"force_pct": "mean force error (%)", "position_mm": "mean position error (mm)"}[column])
    axes.legend(fontsize=7)
    return save(figure, folder, name)


def _surface(folder: Path, name: str, rows: Sequence[LevelErrors]) -> list[Path]:
    """Draw the position error of each level over force and drop-off rate, all on one scale of colours."""
    figure, panels = new_figure(len(LEVELS), width=4.0)
    for axes, level in zip(panels[0], LEVELS, strict=True):
        own = {(e.slope, e.force): e.position_mm for e in rows if e.level == level}
        errors = np.array([[own[slope, force] for force in FORCES] for slope in SLOPES])
        picture = axes.pcolormesh(
            FORCES,
            1e-6 * np.array(SLOPES),
            errors,
            norm=LogNorm(0.05, 10.0),
            shading="nearest",
            cmap="viridis",
        )
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.grid(visible=False)
        axes.set_title(level)
        axes.set_xlabel("force (N)")
        axes.set_ylabel("drop-off rate (MPa/m)")
    figure.colorbar(picture, ax=panels[0].tolist(), label="mean position error (mm)")
    return save(figure, folder, name)


def _zones(folder: Path, name: str, zones: Sequence[NullZone]) -> list[Path]:
    figure, ((axes,),) = new_figure()
    pitch = [zone.pitch_mm for zone in zones]
    for measured, formula, colour, label in (
        ("between", "between_formula", "tab:blue", "half way between two tactels"),
        ("everywhere", "everywhere_formula", "tab:red", "wherever it presses"),
    ):
        axes.plot(pitch, [_value(z, formula) for z in zones], "-", color=colour, label=f"eq. 5, {label}")
        axes.plot(
            pitch, [_value(z, measured) for z in zones], "o", color=colour, mfc="none", label="measured"
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("pitch of the tactels (mm)")
    axes.set_ylabel("least force that is registered (N)")
    axes.legend(fontsize=7)
    return save(figure, folder, name)


def write_table(file: Path, rows: Sequence[Any]) -> Path:
    """Write rows of one dataclass as CSV; return the file."""
    with file.open("w", newline="") as out:
        writer = csv.DictWriter(out, [field.name for field in fields(rows[0])])
        writer.writeheader()
        for row in rows:
            values = asdict(row).items()
            writer.writerow({key: f"{v:.6g}" if isinstance(v, float) else v for key, v in values})
    return file


def _value(row: Any, column: str) -> float:
    return float(asdict(row)[column])
