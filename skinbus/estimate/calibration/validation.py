"""The calibration that is written into boards, and the error to expect of it, at presses not used for it.

Presses are divided into folds; each fold is estimated as the skin estimates contacts, by level ``fit``, with
all that would be written of a calibration made from the others: law, map and noise. Presses at the same
distances from tactels, as on a grid, are in one fold.

Source: M. Stone, Cross-validatory choice and assessment of statistical predictions (1974).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from skinbus.arrays import Bools, Floats
from skinbus.estimate.calibration.learning import STEP, Calibration, learn_radial_law
from skinbus.estimate.calibration.location import PLACE_SD, strongest
from skinbus.estimate.calibration.table import Ints, PressTable
from skinbus.model import Arm

FOLDS = 8
RIM = 0.25
"""Pitches around the tactels within which a press counts: beside them places are not determined as well."""
USUAL = 0.68
"""Part of the presses that have no larger error: the standard deviation, were errors normal."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutErrors:
    """Estimates of presses against what is said of them.

    inside  (n,) presses within the tactels or a quarter of a pitch around, and not left out
    uv      (n, 2) m, estimate minus place said, in the frame of the board; NaN where no contact was found
    sd      (n,) m, what the estimator says of it along each direction
    force   (n,) N, estimates; in units of the force of the presses where that is not known
    """

    inside: Bools
    uv: Floats
    sd: Floats
    force: Floats

    @property
    def found(self) -> Bools:
        """Presses within the tactels that were found."""
        return self.inside & np.isfinite(self.sd)

    def place(self, kept: Bools | None = None) -> float:
        """Return the distance that 68 % of the presses within the tactels do not exceed, m; NaN of none.

        It is infinite where more than a third of them make no contact.
        """
        off = np.hypot(*self.uv[self.inside if kept is None else self.inside & kept].T)
        return (
            float(np.quantile(np.nan_to_num(off, nan=np.inf), USUAL, method="lower"))
            if len(off)
            else math.nan
        )

    def relative_force(self, stated: Floats) -> float:
        """Return the same of the force, as a part of it."""
        off = np.abs(self.force / stated - 1.0)[self.found]
        return float(np.quantile(off, USUAL)) if len(off) else math.nan


def learn(table: PressTable) -> Calibration:
    """Return what is to be written of all rows; ``learn_radial_law`` says what it raises."""
    learned = learn_radial_law(
        table.arm, table.s, table.a, table.force, table.pressures, link=table.link, place_sd=PLACE_SD
    )
    return replace(learned, noise=single_noise(table, learned))


def single_noise(table: PressTable, learned: Calibration) -> Floats:
    """Return the noise of a single reading, (n_tactels,) Pa of true pressure.

    A calibration learns the noise of the readings it is made from. Means have less than what an estimator
    gets, cycle by cycle: with a noise half as large as it is, an arm on which nothing presses finds contacts.
    So it is what the file says, the median of all presses as most are far from a tactel, else what was
    learned, and at least what the board declares.
    """
    noise = np.maximum(learned.noise, table.arm.tactel_noise)
    if table.noise is None:
        return noise
    said = np.isfinite(table.noise).any(axis=0)
    # in the unit of the arm's gains; the learned ones take their place
    gain = learned.gain / table.arm.tactel_gain
    noise[said] = np.nanmedian(table.noise[:, said], axis=0) * gain[said]
    return noise


def cross_validate(table: PressTable, kept: Bools | None = None) -> HeldOutErrors:
    """Return the errors of presses by calibrations that are not made from them, of those that are kept."""
    kept = np.ones(len(table), np.bool_) if kept is None else kept
    fold, found = _folds(table), np.full((len(table), 4), np.nan)
    for k in range(FOLDS):
        test = (fold == k) & kept
        try:
            learned = learn(table.only(kept & ~test))
        except ValueError:
            continue  # as if these presses made no contact
        part = errors_of(table.only(test), learned.apply(table.arm))
        found[test] = np.column_stack([part.uv, part.sd, part.force])
    u, v, sd, force = found.T
    return HeldOutErrors(inside=_inside(table) & kept, uv=np.stack([u, v], -1), sd=sd, force=force)


def errors_of(table: PressTable, arm: Arm) -> HeldOutErrors:
    """Return the errors of an arm that holds some response."""
    gain = arm.tactel_gain / table.arm.tactel_gain
    s, a, force, sd, _ = strongest(arm, table.pressures * gain).T
    return HeldOutErrors(inside=_inside(table), uv=table.uv(s, a) - table.uv(), sd=sd, force=force)


def _inside(table: PressTable) -> Bools:
    uv, inside = table.uv(), np.zeros(len(table), np.bool_)
    for p, placed in enumerate(table.arm.patches):
        rows, tactels, rim = table.patch == p, placed.patch.tactels_uv, RIM * table.pitch
        low, high = tactels.min(axis=0) - rim, tactels.max(axis=0) + rim
        inside[rows] = ((uv[rows] >= low) & (uv[rows] <= high)).all(axis=1)
    return inside


def _folds(table: PressTable) -> Ints:
    """Return the fold of each press, (n,), by its distances from two tactels in steps of the law."""
    alike = np.sort(table.away(), axis=1)[:, :2] / STEP
    places, group = np.unique(np.rint(np.nan_to_num(alike)), axis=0, return_inverse=True)
    order = np.random.default_rng(0).permutation(len(places)) % FOLDS
    return np.asarray(order[np.ravel(group)], np.intp)
