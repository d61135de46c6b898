"""How error and reported covariance grow as a case gets harder: curves against the condition number.

The condition number is that of the Fisher information of (s, a, log force) of all touches at the truth,
scaled to a unit diagonal: what rounding and noise are multiplied by, whatever the units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import LEVELS, Estimator
from skinbus.model import Arm, grid
from tests.hard.ground import NOISE, Ground, Touch, distance_to, pressures_under, touch

Floats = npt.NDArray[np.float64]

TRIALS: Final = 60
_STEP: Final = 1e-7


@dataclass(frozen=True, slots=True)
class Point:
    """What many answers to one case gave; lengths in mm."""

    family: str
    level: str
    hardness: float
    condition: float
    error_mm: float
    """Root mean square of the distance of the first touch (of their centre, where several are answered by one
    contact) from the nearest contact."""
    sigma_mm: float
    """Root mean square of what is reported for it; 0 at level kmeans."""
    force_error: float
    """Root mean square, relative, of the force of that contact."""
    force_sigma: float
    dishonest: float
    """Part of the answers further off than six of their own standard deviations."""
    found: float
    """Part of the cycles with any contact at all."""


Build = Callable[[float], tuple[Arm, list[Touch]]]


def _line(height: float) -> tuple[Arm, list[Touch]]:
    """Tactels in two rows that come together: across them the place is lost in the end."""
    uv = grid(6, 2, 8e-3) * [1.0, height / 8e-3]
    arm = Ground("plane", "radial").board(uv)
    return arm, [touch(arm, 0, 0.001, 0.002, 5.0)]


def _pair(apart: float) -> tuple[Arm, list[Touch]]:
    """Two touches that come together."""
    arm = Ground("plane", "radial").board(grid(4, 4, 10e-3))
    return arm, [touch(arm, 0, -0.5 * apart, 0.001, 6.0), touch(arm, 0, 0.5 * apart, 0.001, 6.0)]


def _off_board(beyond: float) -> tuple[Arm, list[Touch]]:
    """A touch that leaves the tactels of a board over its edge."""
    arm = Ground("plane", "radial").board(grid(4, 4, 10e-3))
    return arm, [touch(arm, 0, 0.001, 0.015 + beyond, 20.0)]


FAMILIES: Final[dict[str, tuple[str, str, Build, Sequence[float]]]] = {
    "line": (
        "two rows of tactels come together", "their distance, mm", _line,
        (16e-3, 8e-3, 4e-3, 2e-3, 1e-3, 0.5e-3, 0.2e-3, 0.05e-3, 1e-5, 1e-7),
    ),
    "pair": (
        "two touches come together", "their distance, mm", _pair,
        (30e-3, 25e-3, 20e-3, 16e-3, 13e-3, 10e-3, 8e-3, 6e-3, 4e-3, 2e-3, 1e-3, 1e-4),
    ),
    "edge": (
        "a touch leaves the tactels", "distance from the last row, mm", _off_board,
        (0.1e-3, 2e-3, 4e-3, 6e-3, 8e-3, 10e-3, 11e-3, 12e-3, 13e-3, 14e-3),
    ),
}  # fmt: skip


def measure_curves(
    trials: int = TRIALS, seed: int = 1, done: Callable[[int], None] | None = None
) -> list[Point]:
    """Return the points of every family and level."""
    points = []
    for family, (_, _, build, hardnesses) in FAMILIES.items():
        for hardness in hardnesses:
            for level in LEVELS:
                points.append(measure_point(family, level, build, hardness, trials, seed))
            if done is not None:
                done(1)
    return points


def measure_point(family: str, level: str, build: Build, hardness: float, trials: int, seed: int) -> Point:
    """Return what many answers to one case gave."""
    arm, touches = build(hardness)
    clean = pressures_under(arm, touches)
    estimator = Estimator(arm, level)
    rng = np.random.default_rng(seed)
    rows = []
    for t_ns in range(trials):
        contacts = estimator.update(clean + NOISE * rng.standard_normal(arm.n_tactels), t_ns)
        if not len(contacts):
            continue
        watched = touches[0] if len(contacts) >= len(touches) else _as_one(touches)
        d = distance_to(arm, watched, contacts.link, contacts.s, contacts.a)
        c = int(d.argmin())
        R = contacts.covariance[c]
        sigma = math.sqrt(float(np.linalg.eigvalsh(R[:2, :2])[-1])) if R.any() else 0.0
        force = contacts.force[c] / watched[3] - 1.0
        rows.append((d[c], sigma, force, math.sqrt(R[2, 2]) / watched[3]))
    table = np.array(rows) if rows else np.full((1, 4), np.nan)
    error, sigma, force, force_sigma = np.sqrt((table**2).mean(axis=0))
    dishonest = float((table[:, 0] > 6.0 * table[:, 1]).mean()) if level != "kmeans" else math.nan
    return Point(
        family, level, hardness, condition_of(arm, touches), 1e3 * float(error), 1e3 * float(sigma),
        float(force), float(force_sigma), dishonest, len(rows) / trials,
    )  # fmt: skip


def _as_one(touches: Sequence[Touch]) -> Touch:
    """Return what touches are that are answered with fewer contacts: all of their force at its centre."""
    force = np.array([t[3] for t in touches])
    s, a = (float(np.average([t[i] for t in touches], weights=force)) for i in (1, 2))
    return (touches[0][0], s, a, float(force.sum()))


def condition_of(arm: Arm, touches: Sequence[Touch]) -> float:
    """Return the condition number of the scaled Fisher information of touches, by central differences."""
    columns = []
    for n in range(len(touches)):
        for part in range(3):
            rows = []
            for sign in (1.0, -1.0):
                changed = [list(t) for t in touches]
                changed[n][1 + part] *= 1.0 + sign * _STEP if part == 2 else 1.0
                changed[n][1 + part] += 0.0 if part == 2 else sign * _STEP
                rows.append(pressures_under(arm, [(int(t[0]), t[1], t[2], t[3]) for t in changed]))
            columns.append((rows[0] - rows[1]) / (2.0 * _STEP))
    jacobian = np.stack(columns, -1)
    scale = np.sqrt((jacobian**2).sum(axis=0))
    singular = np.linalg.svd(jacobian / np.where(scale > 0.0, scale, 1.0), compute_uv=False)
    return float((singular[0] / max(singular[-1], 1e-9 * singular[0])) ** 2)


def draw_curves(points: Sequence[Point], folder: Path) -> Path:
    """Draw error and reported standard deviation against the condition number; return the file."""
    from skinbus.study.draw import COLOURS, new_figure, save

    figure, panels = new_figure(len(FAMILIES), width=4.3, height=3.8)
    for axes, (family, (title, _, _, _)) in zip(panels[0], FAMILIES.items(), strict=True):
        for level in LEVELS:
            own = sorted((p for p in points if (p.family, p.level) == (family, level)), key=_condition)
            x = [p.condition for p in own]
            axes.plot(x, [p.error_mm for p in own], "o-", color=COLOURS[level], ms=4, label=f"{level}: error")
            if level != "kmeans":
                axes.plot(
                    x, [p.sigma_mm for p in own], "--", color=COLOURS[level], label=f"{level}: reported"
                )
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_title(title)
        axes.set_xlabel("condition number of the information")
        axes.set_ylabel("position, root mean square (mm)")
    panels[0][0].legend(fontsize=7)
    return save(figure, folder, "hard-curves")


def _condition(point: Point) -> float:
    return point.condition
