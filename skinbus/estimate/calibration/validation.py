"""The error to expect of a calibration: at presses that it was not made from, and of the law that ships.

Presses are divided into folds; each fold is estimated as the skin estimates contacts, by level ``fit``, with
a calibration made from the others, map and all. Presses at one place are in one fold; where distances to the
tactels are left out, as by presses on a grid, all that lie alike between the tactels are: others share what
is left out.

Source: M. Stone, Cross-validatory choice and assessment of statistical predictions (1974).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from skinbus.estimate.calibration.learning import REACH, Calibration, learn_radial_law
from skinbus.estimate.calibration.location import PLACE_SD
from skinbus.estimate.calibration.response import POINTS, uncovered
from skinbus.estimate.calibration.table import Bools, Floats, Ints, PressTable
from skinbus.estimate.estimator import Estimator
from skinbus.estimate.kernels.layout import limit_of
from skinbus.model import Arm, Cone, Patch

FOLDS: Final = 5
RIM: Final = 0.25
"""Pitches around the tactels within which a press counts: beside them places are not determined as well."""
USUAL: Final = 0.68
"""Part of the presses that have no larger error: the standard deviation, were errors normal."""
SAME_PLACE: Final = 1e-4
"""m, to which places are the same: a tenth of the largest error to expect."""
ALIKE: Final = 0.1
"""Pitches to which places lie alike between tactels: half of it is a step of the table of the law."""
WITHIN: Final = 1.2
"""Pitches up to which the profile must be known: places follow from the flank."""
MOST_UNCOVERED: Final = 1.0 / 3.0
"""Part of these distances that may be without readings: thirty presses at random leave a fifth, those on a
grid of two thirds of the pitch two thirds."""
STEP: Final = 0.125
"""Pitches between the places that are considered for the next press."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutErrors:
    """Estimates of presses against what is said of them.

    inside  (n,) presses within the tactels or a quarter of a pitch around, and not left out
    uv      (n, 2) m, estimate minus place said, in the frame of the board; NaN where no contact was found
    sd      (n,) m, what the estimator says of it
    force   (n,) N, estimates; in units of the force of the presses where that is not known
    misfit  root mean square of what the law leaves of the readings, as a part of theirs
    failed  parts of the presses for which the others teach no law; their presses are not inside
    """

    inside: Bools
    uv: Floats
    sd: Floats
    force: Floats
    misfit: float
    failed: int = 0

    @property
    def found(self) -> Bools:
        """Presses within the tactels that were found."""
        return np.asarray(self.inside & np.isfinite(self.uv[:, 0]))

    def place(self, kept: Bools | None = None) -> float:
        """Return the distance that 68 % of the presses within the tactels do not exceed, m; NaN of none."""
        rows = self.found if kept is None else self.found & kept
        return float(np.quantile(np.hypot(*self.uv[rows].T), USUAL)) if rows.any() else math.nan

    def relative_force(self, stated: Floats) -> float:
        """Return the same of the force, as a part of it."""
        off = np.abs(self.force / stated - 1.0)[self.found]
        return float(np.quantile(off, USUAL)) if len(off) else math.nan


def learn(table: PressTable, *, maps: bool = True) -> Calibration:
    """Return the calibration from all rows; ``learn_radial_law`` says what it raises."""
    presses = (table.arm, table.s, table.a, table.force, table.pressures)
    return learn_radial_law(*presses, link=table.link, place_sd=PLACE_SD, maps=maps)


def cross_validate(table: PressTable, kept: Bools | None = None, *, folds: int = FOLDS) -> HeldOutErrors:
    """Return the errors of presses by calibrations that are not made from them, of those that are kept."""
    kept = np.ones(len(table), np.bool_) if kept is None else kept
    fold = _folds(table, folds)
    inside, failed, left, total = _inside(table) & kept, 0, 0.0, 0.0
    uv, (sd, force) = np.full((len(table), 2), np.nan), np.full((2, len(table)), np.nan)
    for k in range(folds):
        test = (fold == k) & kept
        try:
            learned = learn(table.only(kept & ~test))
        except ValueError:
            inside &= ~test
            failed += 1
            continue
        part = errors_of(table, learned.apply(table.arm), test)
        uv[test], sd[test], force[test] = part.uv[test], part.sd[test], part.force[test]
        own = float(np.nansum(table.pressures[test] ** 2))
        left, total = left + part.misfit**2 * own, total + own
    misfit = math.sqrt(left / max(total, 1e-300))
    return HeldOutErrors(inside=inside, uv=uv, sd=sd, force=force, misfit=misfit, failed=failed)


def errors_of(
    table: PressTable, arm: Arm, kept: Bools | None = None, *, free_scale: bool = False
) -> HeldOutErrors:
    """Return the errors of an arm that holds some response; ``free_scale`` leaves its force open."""
    kept = np.ones(len(table), np.bool_) if kept is None else kept
    readings = table.pressures * (np.asarray(arm.tactel_gain) / np.asarray(table.arm.tactel_gain))
    estimator, inside = Estimator(arm, "fit"), _inside(table) & kept
    s, a, sd, force = np.full((4, len(table)), np.nan)
    for i in np.flatnonzero(inside).tolist():
        contacts = estimator.update(readings[i], i)
        if len(contacts):
            best = int(contacts.force.argmax())
            s[i], a[i], force[i] = contacts.s[best], contacts.a[best], contacts.force[best]
            sd[i] = math.sqrt(np.trace(contacts.covariance[best, :2, :2]))
    uv = table.uv(np.nan_to_num(s), np.nan_to_num(a)) - table.uv()
    uv[~np.isfinite(s)] = np.nan
    misfit = _misfit(table.only(kept), arm, readings[kept], free_scale=free_scale or table.force is None)
    return HeldOutErrors(inside=inside, uv=uv, sd=sd, force=force, misfit=misfit)


def _inside(table: PressTable) -> Bools:
    rim, uv, out = RIM * table.pitch, table.uv(), np.zeros(len(table), np.bool_)
    for p in np.unique(table.patch):
        tactels, rows = np.asarray(table.arm.patches[p].patch.tactels_uv), table.patch == p
        low, high = tactels.min(axis=0) - rim, tactels.max(axis=0) + rim
        out[rows] = ((uv[rows] >= low) & (uv[rows] <= high)).all(axis=1)
    return out


def _misfit(table: PressTable, arm: Arm, readings: Floats, *, free_scale: bool) -> float:
    """Return the root mean square of readings minus law, as a part of that of the readings."""
    d = table.away()
    usable = np.isfinite(readings) & (d < REACH) & (readings < limit_of(arm)) & arm.tactel_healthy
    left = total = 0.0
    for p in np.unique(table.patch).tolist():
        rows, here = table.patch == p, arm.tactels_of(p)
        use, law = usable[rows, here], arm.patches[p].patch.law
        width = 1.0 if isinstance(law, Cone) else arm.tactel_width[here]
        law_says = law.pressure(np.where(use, d[rows, here], 0.0) / width, table.forces[rows, None])
        own, expected = readings[rows, here][use], (law_says + arm.tactel_bias[here])[use]
        if free_scale:
            expected = expected * float(own @ expected) / max(float(expected @ expected), 1e-300)
        left, total = left + float(((own - expected) ** 2).sum()), total + float(own @ own)
    return math.sqrt(left / max(total, 1e-300))


def _folds(table: PressTable, folds: int) -> Ints:
    """Return the fold of each press, (n,)."""
    places = np.column_stack([table.patch, np.rint(np.stack([table.s, table.a], -1) / SAME_PLACE)])
    if gaps_of(table):
        alike = np.rint(_between(table) / ALIKE)
        if len(np.unique(alike, axis=0)) > 1:
            places = alike
    _, group = np.unique(places, axis=0, return_inverse=True)
    group = np.ravel(group)
    return np.asarray((np.random.default_rng(0).permutation(group.max() + 1) % folds)[group], np.intp)


def _between(table: PressTable) -> Floats:
    """Return the distances of presses from their nearest tactels along u and v, (n, 2) in pitches, sorted."""
    uv, out = table.uv(), np.zeros((len(table), 2))
    for p in np.unique(table.patch):
        rows = table.patch == p
        away = np.abs(uv[rows][:, None] - np.asarray(table.arm.patches[p].patch.tactels_uv))
        nearest = np.hypot(*away.T).T.argmin(axis=1)
        out[rows] = np.sort(away[np.arange(len(away)), nearest], axis=1) / table.pitch
    return out


def gaps_of(table: PressTable) -> list[tuple[float, float]]:
    """Return the distances (from, to) m at which no reading determines the law; none where these are few."""
    step, d = REACH / (POINTS - 1), table.away()
    last = int(min(WITHIN * table.pitch, REACH) / step)
    bare = uncovered(d[(d < REACH) & np.isfinite(table.pressures)], step)[: last + 1] > 0
    if bare.mean() <= MOST_UNCOVERED:
        return []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bare, [False]]).astype(int))).reshape(-1, 2)
    return [(step * max(first - 0.5, 0.0), step * (end - 0.5)) for first, end in edges.tolist()]


def next_place(patch: Patch, pressed: Floats) -> Floats:
    """Return the place (2,) m on a board that is farthest from those pressed, (n, 2) m.

    Places lie within the tactels and a quarter of a pitch around; the first is the middle.
    """
    uv, pitch = np.asarray(patch.tactels_uv), patch.pitch
    low, high = uv.min(axis=0) - RIM * pitch, uv.max(axis=0) + RIM * pitch
    if not len(pressed):
        return np.asarray(0.5 * (low + high))
    counts = np.maximum(np.ceil((high - low) / (STEP * pitch)), 1.0).astype(int) + 1
    at = np.stack(np.meshgrid(*map(np.linspace, low, high, counts)), -1).reshape(-1, 2)
    apart = np.hypot(*(at[:, None] - pressed).T).min(axis=0)
    return np.asarray(at[int(apart.argmax())])
