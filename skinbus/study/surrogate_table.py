"""Skins as they are: contact errors on surrogates of a measured array, by number of presses."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate import Estimator, learn_radial_law
from skinbus.study.surrogate import Surrogate

Floats = npt.NDArray[np.float64]

PITCHES_MM: Final = (6.75, 8.75, 9.9)
PRESSES: Final = (100, 300, 1600)
LEVELS: Final = ("fit", "full")
ARRAYS: Final = 4
"""Surrogates of each pitch and number of presses: each is another array."""
CONTACTS: Final = 250
"""Of each array, at places that it was not calibrated at."""
FAR: Final = 3.0
"""mm"""
LIMITS: Final = {
    (9.9, 300): {"mean mm": 0.5, "p95 mm": 1.5, "over 3 mm %": 1.0, "cv of force": 0.15},
    (9.9, 100): {"mean mm": 0.65},
    (8.75, 300): {"mean mm": 0.25, "cv of force": 0.06},
    (6.75, 300): {"mean mm": 0.25, "cv of force": 0.06},
}
NEES: Final = (0.5, 2.0)


@dataclass(frozen=True, slots=True)
class SurrogateErrors:
    """Errors of contacts: position in mm, force as a factor, NEES per degree of freedom; (n,) each."""

    position: Floats
    force: Floats
    nees: Floats

    def figures(self) -> dict[str, float]:
        """Return the figures of a row by their names."""
        return {
            "mean mm": float(self.position.mean()),
            "p95 mm": float(np.quantile(self.position, 0.95)),
            "over 3 mm %": float(100.0 * np.mean(self.position > FAR)),
            "cv of force": float(self.force.std() / self.force.mean()),
            "NEES": float(self.nees.mean()),
        }


def measure_array(pitch_mm: float, n_presses: int, seed: int, number: int) -> dict[str, SurrogateErrors]:
    """Return the errors of each level on one calibrated surrogate; infinite where no contact is found."""
    rng = np.random.default_rng([seed, number, n_presses, round(100.0 * pitch_mm)])
    surrogate = Surrogate(1e-3 * pitch_mm, rng)
    presses = surrogate.presses(n_presses)
    learned = learn_radial_law(surrogate.arm, presses.s, presses.a, None, presses.readings)
    arm = learned.apply(surrogate.arm)
    s, a = surrogate.places(CONTACTS)
    readings = surrogate.read(s, a) * learned.gain
    found = {}
    for level in LEVELS:
        estimator = Estimator(arm, level)
        rows = np.full((CONTACTS, 3), np.inf)
        for k, pressures in enumerate(readings):
            contacts = estimator.update(pressures, k)
            if not len(contacts):
                continue
            c = int(np.argmax(contacts.force))
            error = np.array([contacts.s[c] - s[k], contacts.a[c] - a[k], contacts.force[c] - 1.0])
            nees = float(error @ np.linalg.solve(contacts.covariance[c], error)) / 3.0
            rows[k] = 1e3 * np.hypot(error[0], error[1]), contacts.force[c], nees
        found[level] = SurrogateErrors(*rows.T)
    return found


def measure_surrogates(
    executor: Executor, *, seed: int, quick: bool, done: Callable[[int], None] = lambda n: None
) -> dict[tuple[float, int, str], SurrogateErrors]:
    """Return the errors by pitch (mm), number of presses and level."""
    presses = PRESSES[:2] if quick else PRESSES
    arrays = 1 if quick else ARRAYS
    futures = {
        (pitch, n, number): executor.submit(measure_array, pitch, n, seed, number)
        for pitch in PITCHES_MM
        for n in presses
        for number in range(arrays)
    }
    found: dict[tuple[float, int, str], SurrogateErrors] = {}
    for (pitch, n, _), future in futures.items():
        for level, errors in future.result().items():
            before = found.get((pitch, n, level))
            joined = errors if before is None else _join(before, errors)
            found[pitch, n, level] = joined
        done(1)
    return found


def _join(one: SurrogateErrors, other: SurrogateErrors) -> SurrogateErrors:
    return SurrogateErrors(
        np.concatenate([one.position, other.position]),
        np.concatenate([one.force, other.force]),
        np.concatenate([one.nees, other.nees]),
    )


def missed_surrogates(found: dict[tuple[float, int, str], SurrogateErrors]) -> list[str]:
    """Return a line for every figure that misses its limit."""
    lines = []
    for (pitch, n, level), errors in found.items():
        figures = errors.figures()
        where = f"array at {pitch:g} mm, {n} presses, {level}"
        limits = LIMITS.get((pitch, n), {})
        lines += [
            f"{where}: {name} {figures[name]:.3g}, must {limit:g}"
            for name, limit in limits.items()
            if not figures[name] <= limit
        ]
        if limits and not NEES[0] <= figures["NEES"] <= NEES[1]:
            lines.append(f"{where}: NEES {figures['NEES']:.3g}, must be {NEES[0]:g} to {NEES[1]:g}")
    return lines


def write_surrogates(found: dict[tuple[float, int, str], SurrogateErrors]) -> str:
    """Return the table in Markdown."""
    names = ("mean mm", "p95 mm", "over 3 mm %", "cv of force", "NEES")
    lines = [
        "### Skins as they are: surrogates of a measured array of eight tactels, one contact, load unknown",
        "",
        f"| pitch mm | presses | level | {' | '.join(names)} |",
        "|---|---|---|" + "---|" * len(names),
    ]
    for (pitch, n, level), errors in found.items():
        figures, limits = errors.figures(), LIMITS.get((pitch, n), {})
        cells = []
        for name in names:
            cell = f"{figures[name]:.2f}"
            if name in limits:
                cell += f" (≤ {limits[name]:g})" + ("" if figures[name] <= limits[name] else " **missed**")
            cells.append(cell)
        lines.append(f"| {pitch:g} | {n} | {level} | {' | '.join(cells)} |")
    return "\n".join([*lines, ""])
