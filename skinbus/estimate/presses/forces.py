"""Whether forces go with the readings, and by what power of ten they may be off.

The pressures under a press add up to its force, whatever the layer: the integral of the law over the surface
is 1 in N/N where forces and full scale are true. Only their ratio can be checked, and only roughly: covers
that carry a part of the load, or full scales that are nominal, change it by a factor of two or three.
"""

from __future__ import annotations

import math

import numpy as np

from skinbus.estimate.calibration import Calibration
from skinbus.estimate.presses.cross_validation import HeldOutErrors
from skinbus.estimate.presses.table import Floats, PressTable, strength
from skinbus.model import Arm, Cone, Law

FACTOR = math.sqrt(10.0)
"""By which pressures and forces may disagree: between it and its inverse lies one decade."""
UNITS = {
    "force_n in kgf": 9.81,
    "force_n in lbf": 4.45,
    "force_n in kN": 1e3,
    "force_n in g": 9.81e-3,
    "force_n in mN, or readings in kPa": 1e-3,
    "readings that are not left-adjusted, of 12 bits in 16": 1.0 / 16.0,
}
"""Factors between the pressures' sum and force_n that such mistakes make."""
MAX_ERROR = 0.3
"""Relative error of force, 68 % of the presses, beyond which forces belong to other presses."""
LEAST_ROWS, STEP, BETTER = 8, 0.05, 0.8
"""Rows, and change of scale, that are named; what an alternative may leave of what a power law leaves.
Of 60 presses chance leaves 0.9."""
MOST_STEPS = 200
"""Rows of large files at which another scale may begin: to half a percent of them."""
MIN_RATIO = 1.3
"""Largest by smallest force from which the exponent and the order of forces can be checked."""


def force_findings(
    table: PressTable, learned: Calibration, errors: HeldOutErrors
) -> tuple[list[str], list[str]]:
    """Return faults of the forces, and what cannot be known of them, as sentences."""
    if table.force is None:
        return [], ["forces are not known: nothing of them can be checked"]
    faults, notes = _scale(table, learned)
    found = errors.found
    if found.any() and errors.relative_force(table.force) > MAX_ERROR:
        faults.append(
            f"forces deviate by {100 * errors.relative_force(table.force):.0f} % from what the readings say"
            + _order(table)
        )
    if table.force.max() < MIN_RATIO * table.force.min():
        notes.append("all forces are about the same: the law is taken to be linear in the force")
    elif not 0.5 <= learned.law.exponent <= 1.6:
        faults.append(
            f"pressures grow as force^{learned.law.exponent:.2f}, as under no cover: "
            "are the forces those of the presses?"
        )
    return faults, notes


def uneven_forces(table: PressTable, errors: HeldOutErrors, exponent: float) -> list[tuple[str, int | None]]:
    """Return how stated forces would go with the readings, a sentence, and the row from which that holds.

    Nothing where they go with them by one power law. The alternatives have as many parameters or one more: a
    tare, under a cover that is linear in the force, and another scale from some row on.
    """
    rows = np.flatnonzero(errors.found)
    if table.force is None or len(rows) < 2 * LEAST_ROWS:
        return []
    stated, log_read = table.force[rows], exponent * np.log(errors.force[rows])
    power = np.column_stack([np.ones(len(rows)), np.log(stated)])
    usual = _rms(power, log_read)
    tares = np.concatenate(
        [stated.min() * np.linspace(-0.9, 0.0, 10), stated.max() * np.linspace(0.0, 0.5, 26)]
    )
    left = [_rms(power[:, :1], log_read - np.log(stated + tare)) for tare in tares]
    k = int(np.argmin(left))
    firsts = np.unique(np.linspace(LEAST_ROWS, len(rows) - LEAST_ROWS, MOST_STEPS, dtype=np.intp))
    order = np.arange(len(rows))
    after = [_rms(np.column_stack([power, order >= first]), log_read) for first in firsts]
    first = int(firsts[np.argmin(after)])
    if min(after) < min(BETTER * usual, left[k]):
        _, slope, step = np.linalg.lstsq(np.column_stack([power, order >= first]), log_read)[0]
        factor = math.exp(-step / slope)
        if abs(math.log(factor)) > STEP:
            what = (
                f"forces are stated from there on {factor:.2f} times as high as before, as the readings say"
            )
            return [(what, int(rows[first]))]
    elif left[k] < BETTER * usual:
        do = "added to" if tares[k] > 0.0 else "taken off"
        what = f"forces would go with the readings of a linear cover if {abs(tares[k]):.1f} N were {do} each"
        return [(f"{what}: was the scale at 0 N while nothing was pressed?", None)]
    return []


def _rms(columns: Floats, values: Floats) -> float:
    """Return what a linear fit leaves, RMS."""
    return float(np.std(values - columns @ np.linalg.lstsq(columns, values)[0]))


def _scale(table: PressTable, learned: Calibration) -> tuple[list[str], list[str]]:
    assert table.force is not None
    typical = float(np.exp(np.mean(np.log(table.force))))
    ratio = load_ratio(learned.law, typical)
    usual = float(np.median([load_ratio(law, typical) for law in _laws(table.arm)]))
    known = (
        f"the pressures under a press add up to {ratio:.3g} times its force, by the law that the boards have "
        f"to {usual:.2g}"
    )
    off = min((ratio, ratio / usual), key=lambda x: abs(math.log(x)))
    if 1.0 / FACTOR <= off <= FACTOR:
        return [], []
    power = round(math.log10(off))
    near = [name for name, factor in UNITS.items() if abs(math.log(off / factor)) < math.log(2.0)]
    unit = f", as by {' or by '.join(near)}" if near else ""
    return [
        f"{known}: forces or pressures are off by a factor near 10^{power}{unit}. Only the ratio of force_n "
        "and the full scale in the EDS is seen here, and only within a factor of three"
    ], []


def load_ratio(law: Law, force: float) -> float:
    """Return the integral of the pressures of a press over the plane, by its force (N)."""
    effective = force**law.exponent
    if isinstance(law, Cone):
        return float(effective / force)
    d = np.linspace(0.0, law.step * (len(law.table) - 1), 1000)
    return float(max(effective / force * np.trapezoid(2.0 * np.pi * d * law.profile(d), d), 1e-12))


def _laws(arm: Arm) -> list[Law]:
    return [placed.patch.law for placed in arm.patches]


def _order(table: PressTable) -> str:
    """Return whether forces of neighbouring rows go with the readings."""
    assert table.force is not None
    force, strong = np.log(table.force), np.log(np.maximum(strength(table) * table.force, 1e-12))
    n = len(force)
    if n < 20 or not np.ptp(force):
        return ""
    scores = {
        lag: float(
            np.corrcoef(force[max(0, -lag) : n - max(0, lag)], strong[max(0, lag) : n - max(0, -lag)])[0, 1]
        )
        for lag in range(-3, 4)
    }
    best = max(scores, key=lambda lag: scores[lag])
    if best and scores[best] > scores[0] + 4.0 / math.sqrt(n):
        where = f"{abs(best)} row{'s' if abs(best) > 1 else ''} {'further' if best > 0 else 'before'}"
        return f"; they would go with the readings {where}"
    return ""
