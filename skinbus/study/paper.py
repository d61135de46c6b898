"""The paper's experiments under its own conditions: cone truth, cone inversion, random K-means start.

The paper's board, 4 x 4 tactels at 10 mm, is pressed at random places between its outer tactels. Varied are
the force (figures 9, 10), the drop-off rate of the cone (11, 12), and both together (13); for figures 7 and 8
a square of 50 mm is filled with more and less tactels. All levels see the same readings.

The paper states neither its noise nor its ranges. Here a reading has 1 % noise of the peak under the force of
reference, a tactel counts as touched at five times that, and K is known, as it is in the paper.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from skinbus.arrays import Floats
from skinbus.estimate import LEVELS, Estimator
from skinbus.model import Arm, Cone, Transducer
from skinbus.model.patch import grid

SPAN = 0.030
"""Side of the square that is pressed, m: the distance of the outer tactels of the paper's board."""
EDGE = 0.050
"""Side of the board of figures 7 and 8, m."""
PER_SIDE = (2, 3, 4, 5, 6, 7, 8)
"""Tactels along its side; pitches of 25 to 6.25 mm."""
FORCES = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 17.0, 25.0)
"""N; the paper shows up to 25 N."""
SLOPES = (0.15e6, 0.3e6, 0.6e6, 1.2e6, 2.5e6, 5e6, 10e6, 20e6)
"""Drop-off rates, Pa/m."""
FORCE = 5.0
SLOPE = 5e6
SIDE = 4
PITCH = 0.010
"""Of reference: what is not varied. There the cone reaches as far as the next tactel, 9.8 mm."""
NOISE_SHARE = 0.01
THRESHOLD = 5.0
"""In standard deviations of a reading."""
APART = 0.018
"""Two touches are at least so far apart, m: nearer ones are one to any partition of a 10 mm grid."""
_EXACT = Transducer(full_scale=1e7, bits=32)  # "saturation" in the paper is one of the layer


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperCase:
    """One cell of an experiment."""

    side: int = SIDE
    pitch: float = PITCH
    slope: float = SLOPE
    force: float = FORCE
    n_touches: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelErrors(PaperCase):
    """Errors of one level in one cell of an experiment."""

    level: str
    trials: int
    found: float
    """Share of the touches that have a contact."""
    position_mm: float
    """Mean over the touches found; NaN when there is none. So are those below."""
    position_sd_mm: float
    force_pct: float
    force_sd_pct: float


def board(side: int, pitch: float, slope: float, *, noise: float, threshold: float) -> Arm:
    """Return the board of ``side`` x ``side`` tactels with a cone of this drop-off rate (Pa/m)."""
    return Arm.single_patch(
        grid(side, side, pitch),
        law=Cone(slope),
        noise=noise,
        threshold=threshold,
        release=threshold,
        transducer=_EXACT,
    )


def press(case: PaperCase, *, trials: int, seed: int) -> list[LevelErrors]:
    """Return the errors of every level on the same random touches of one force."""
    slope, force, n_touches = case.slope, case.force, case.n_touches
    rng = np.random.default_rng(
        [seed, case.side, round(1e6 * case.pitch), round(slope), round(1000 * force), n_touches]
    )
    noise = NOISE_SHARE * float(Cone(SLOPE).height(FORCE))
    arm = board(case.side, case.pitch, slope, noise=noise, threshold=THRESHOLD * noise)
    places = np.stack([_places(rng, n_touches) for _ in range(trials)])
    d = np.linalg.norm(np.stack([arm.tactel_s, arm.tactel_a], -1)[None, None] - places[:, :, None], axis=-1)
    readings = Cone(slope).pressure(d, force).sum(1) + rng.normal(0.0, noise, (trials, arm.n_tactels))

    results = []
    for level in LEVELS:
        estimator = Estimator(arm, level, start="random", k=n_touches, seed=seed)
        errors = []
        for truth, pressures in zip(places, readings, strict=True):
            contacts = estimator.update(pressures, 0)
            away = np.hypot(truth[:, :1] - contacts.s, truth[:, 1:] - contacts.a)
            rows, columns = linear_sum_assignment(away)
            off = np.abs(contacts.force[columns] - force) / force
            errors.append(np.column_stack([1e3 * away[rows, columns], 1e2 * off]))
        every = np.concatenate(errors)
        found = len(every) / (trials * n_touches)
        if not len(every):
            every = np.full((1, 2), np.nan)
        (position, force_pct), (position_sd, force_sd) = every.mean(0).tolist(), every.std(0).tolist()
        results.append(
            LevelErrors(
                level=level,
                trials=trials,
                found=found,
                position_mm=position,
                position_sd_mm=position_sd,
                force_pct=force_pct,
                force_sd_pct=force_sd,
                **asdict(case),
            )
        )
    return results


SWEEPS = {
    "density": [PaperCase(side=side, pitch=EDGE / side, n_touches=n) for n in (1, 2) for side in PER_SIDE],
    "force": [PaperCase(force=force, n_touches=n) for n in (1, 2) for force in FORCES],
    "drop-off": [PaperCase(slope=slope, n_touches=n) for n in (1, 2) for slope in SLOPES],
    "force-and-drop-off": [PaperCase(slope=slope, force=force) for slope in SLOPES for force in FORCES],
}
"""Of figures 7 and 8, 9 and 10, 11 and 12, and 13."""
N_CELLS = sum(map(len, SWEEPS.values()))
TRIALS = 400
"""Random touches of each cell."""


def make_all(folder: Path, *, done: Callable[[int], None]) -> None:
    """Run the paper's experiments; write tables (CSV) and figures (SVG).

    Args:
        folder: of the files.
        done: called with 1 after each of ``N_CELLS`` cells.
    """
    from skinbus.study.draw import COLOURS, MARKERS, new_figure, save

    results: dict[str, list[LevelErrors]] = {}
    for sweep, cases in SWEEPS.items():
        results[sweep] = []
        for case in cases:
            results[sweep] += press(case, trials=TRIALS, seed=0)
            done(1)
    for number, sweep, field, unit, label in (
        (7, "density", "pitch", 1e3, "pitch of the tactels (mm)"),
        (9, "force", "force", 1.0, "force (N)"),
        (11, "drop-off", "slope", 1e-6, "drop-off rate (MPa/m)"),
    ):
        for offset, (error, column, title) in enumerate(
            (("force", "force_pct", "force error (%)"), ("position", "position_mm", "position error (mm)"))
        ):
            figure, ((axes,),) = new_figure()
            for level, (n, dash) in product(LEVELS, ((1, "-"), (2, "--"))):
                own = [e for e in results[sweep] if e.level == level and e.n_touches == n]
                x, y = [unit * getattr(e, field) for e in own], [getattr(e, column) for e in own]
                style = {"color": COLOURS[level], "marker": MARKERS[level], "ms": 3.5}
                axes.plot(x, y, dash, label=f"{level}, {n} touch{'es' * (n > 1)}", **style)
            axes.set(xscale="log", yscale="log", xlabel=label, ylabel=f"mean {title}")
            axes.legend(fontsize=7)
            save(figure, folder / f"paper-fig{number + offset:02d}-{error}-error-{sweep}.svg")

    figure, panels = new_figure(len(LEVELS), width=4.0)
    for axes, level in zip(panels[0], LEVELS, strict=True):
        mean = [e.position_mm for e in results["force-and-drop-off"] if e.level == level]
        errors, slopes = np.reshape(mean, (len(SLOPES), len(FORCES))), 1e-6 * np.array(SLOPES)
        picture = axes.pcolormesh(FORCES, slopes, errors, norm="log", vmin=0.05, vmax=10.0, shading="nearest")
        axes.set(xscale="log", yscale="log", title=level, xlabel="force (N)", ylabel="drop-off rate (MPa/m)")
        axes.grid(visible=False)
    figure.colorbar(picture, ax=panels[0].tolist(), label="mean position error (mm)")
    save(figure, folder / "paper-fig13-position-error-force-and-drop-off.svg")
    write_table(folder / "paper.csv", [row for rows in results.values() for row in rows])


def write_table(file: Path, rows: Sequence[Any]) -> None:
    """Write rows of one dataclass as CSV, real numbers with 6 digits."""
    with file.open("w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(asdict(rows[0]))
        for row in rows:
            writer.writerow(f"{v:.6g}" if isinstance(v, float) else v for v in asdict(row).values())


def _places(rng: np.random.Generator, n: int) -> Floats:
    """Return n places (n, 2) m between the tactels, apart from each other."""
    while True:
        places = rng.uniform(-0.5 * SPAN, 0.5 * SPAN, (n, 2))
        if n == 1 or np.linalg.norm(places[0] - places[1]) >= APART:
            return places
