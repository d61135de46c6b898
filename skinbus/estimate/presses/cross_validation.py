"""The error to expect of a calibration: at presses that it was not made from, and of the law that ships.

Presses are divided into folds; each fold is estimated as the skin estimates contacts, by level ``fit``, with
a calibration made from the others. Presses at one place are in one fold; where distances to the tactels are
left out, as by presses on a grid, all that lie alike between the tactels are: others share what is left out.

Source: M. Stone, Cross-validatory choice and assessment of statistical predictions (1974).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinbus.estimate.calibration import REACH, Calibration, learn_radial_law
from skinbus.estimate.estimator import Estimator
from skinbus.estimate.kernels.layout import limit_of
from skinbus.estimate.location import PLACE_SD
from skinbus.estimate.presses.spread import gaps_of
from skinbus.estimate.presses.table import Bools, Floats, Ints, PressTable
from skinbus.model import Arm, Cone

FOLDS = 5
RIM = 0.25
"""Pitches around the tactels within which a press counts: beside them places are not determined as well."""
USUAL = 0.68
"""Part of the presses that have no larger error: the standard deviation, were errors normal."""
SAME_PLACE = 1e-4
"""m, to which places are the same: a tenth of the largest error to expect."""
ALIKE = 0.1
"""Pitches to which places lie alike between tactels: half of it is a step of the table of the law."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutErrors:
    """Estimates of presses against what is said of them.

    inside  (n,) presses within the tactels or a quarter of a pitch around
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
        return float(np.quantile(np.hypot(*self.uv[rows].T), USUAL)) if rows.any() else float("nan")

    def relative_force(self, stated: Floats, kept: Bools | None = None) -> float:
        """Return the same of the force, as a part of it."""
        rows = self.found if kept is None else self.found & kept
        if not rows.any():
            return float("nan")
        return float(np.quantile(np.abs(self.force[rows] / stated[rows] - 1.0), USUAL))


def learn(table: PressTable, *, maps: bool = True) -> Calibration:
    """Return the calibration from all rows; ``learn_radial_law`` says what it raises."""
    return learn_radial_law(
        table.arm,
        table.s,
        table.a,
        table.force,
        table.pressures,
        link=table.link,
        place_sd=PLACE_SD,
        maps=maps,
    )


def cross_validate(table: PressTable, *, folds: int = FOLDS, seed: int = 0) -> HeldOutErrors:
    """Return the errors at presses that calibrations without maps are not made from; maps reduce them."""
    fold = _folds(table, folds, seed)
    uv = np.full((len(table), 2), np.nan)
    sd, force = np.full(len(table), np.nan), np.full(len(table), np.nan)
    left, all_of = 0.0, 0.0
    inside, failed = _inside(table), 0
    for k in range(folds):
        test = fold == k
        if not test.any():
            continue
        try:
            learned = learn(table.only(~test), maps=False)
        except ValueError:
            inside &= ~test
            failed += 1
            continue
        part = errors_of(table.only(test), learned.apply(table.arm))
        uv[test], sd[test], force[test] = part.uv, part.sd, part.force
        own = _square(table.only(test))
        left, all_of = left + part.misfit**2 * own, all_of + own
    misfit = float(np.sqrt(left / max(all_of, 1e-300)))
    return HeldOutErrors(inside=inside, uv=uv, sd=sd, force=force, misfit=misfit, failed=failed)


def _folds(table: PressTable, folds: int, seed: int) -> Ints:
    """Return the fold of each press, (n,)."""
    places = np.column_stack([table.patch, np.rint(np.stack([table.s, table.a], -1) / SAME_PLACE)])
    if gaps_of(table):
        alike = np.rint(_between(table) / ALIKE)
        if len(np.unique(alike, axis=0)) > 1:
            places = alike
    _, first, group = np.unique(places, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))  # groups in the order of the table
    shuffled = np.random.default_rng(seed).permutation(len(first)) % folds
    return np.asarray(shuffled[order[np.ravel(group)]], np.intp)


def _between(table: PressTable) -> Floats:
    """Return the distances of presses from their nearest tactels along u and v, (n, 2) in pitches, sorted."""
    uv, out = table.uv(), np.zeros((len(table), 2))
    for p in np.unique(table.patch):
        patch, rows = table.arm.patches[p].patch, table.patch == p
        tactels = np.asarray(patch.tactels_uv)
        away = uv[rows][:, None] - tactels
        nearest = np.hypot(*away.T).T.argmin(axis=1)
        away = np.abs(away[np.arange(len(away)), nearest])
        out[rows] = np.sort(away, axis=1) / patch.pitch
    return out


def errors_of(table: PressTable, arm: Arm, *, free_scale: bool = False) -> HeldOutErrors:
    """Return the errors of an arm that holds some response; ``free_scale`` leaves its force open."""
    gain = np.asarray(arm.tactel_gain) / np.asarray(table.arm.tactel_gain)
    readings = table.pressures * gain
    estimator = Estimator(arm, "fit")
    s, a = np.full(len(table), np.nan), np.full(len(table), np.nan)
    sd, force = np.full(len(table), np.nan), np.full(len(table), np.nan)
    inside = _inside(table)
    for i in np.flatnonzero(inside).tolist():
        contacts = estimator.update(readings[i], i)
        if len(contacts):
            strongest = int(contacts.force.argmax())
            s[i], a[i] = contacts.s[strongest], contacts.a[strongest]
            force[i] = contacts.force[strongest]
            sd[i] = np.sqrt(np.trace(contacts.covariance[strongest, :2, :2]))
    return HeldOutErrors(
        inside=inside,
        uv=table.uv(np.nan_to_num(s), np.nan_to_num(a))
        - table.uv()
        + np.where(np.isfinite(s), 0.0, np.nan)[:, None],
        sd=sd,
        force=force,
        misfit=_misfit(table, arm, readings, free_scale=free_scale or table.force is None),
    )


def _inside(table: PressTable) -> Bools:
    uv, out = table.uv(), np.zeros(len(table), np.bool_)
    for p in np.unique(table.patch):
        patch = table.arm.patches[p].patch
        tactels = np.asarray(patch.tactels_uv)
        rim = RIM * patch.pitch
        rows = table.patch == p
        low, high = tactels.min(axis=0) - rim, tactels.max(axis=0) + rim
        out[rows] = ((uv[rows] >= low) & (uv[rows] <= high)).all(axis=1)
    return out


def _square(table: PressTable) -> float:
    return float(np.nansum(table.pressures**2))


def _misfit(table: PressTable, arm: Arm, readings: Floats, *, free_scale: bool) -> float:
    """Return the root mean square of readings minus law, as a part of that of the readings."""
    p, d = _readings_near(table, arm, readings)
    left = total = 0.0
    forces = np.ones(len(table)) if table.force is None else table.force
    for q in np.unique(table.patch):
        rows, here = np.flatnonzero(table.patch == q), arm.tactels_of(int(q))
        own, distance = p[rows, here], d[rows, here]
        law = arm.patches[q].patch.law
        width = 1.0 if isinstance(law, Cone) else arm.tactel_width[here]
        expected = law.pressure(distance / width, forces[rows, None]) + arm.tactel_bias[here]
        usable = np.isfinite(own)
        own, expected = own[usable], expected[usable]
        if free_scale:
            expected = expected * float(own @ expected) / max(float(expected @ expected), 1e-300)
        left, total = left + float(((own - expected) ** 2).sum()), total + float((own**2).sum())
    return float(np.sqrt(left / max(total, 1e-300)))


def _readings_near(table: PressTable, arm: Arm, readings: Floats) -> tuple[Floats, Floats]:
    """Return readings, NaN where they do not depend on the law, and distances (m) from their presses."""
    p, d = readings.copy(), np.full(readings.shape, np.inf)
    for q in np.unique(table.patch):
        rows, here = np.flatnonzero(table.patch == q), arm.tactels_of(int(q))
        d[rows, here.start : here.stop] = arm.distance(here, table.s[rows], table.a[rows])
    usable = (d < REACH) & (p < limit_of(arm)) & np.asarray(arm.tactel_healthy)
    return np.where(usable, p, np.nan), d
