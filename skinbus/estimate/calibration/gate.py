"""The gate of a calibration: what presses cannot be is refused, with what would explain it.

In the order of what spoils most: places against those that the law which the boards have gives the readings,
zeros, how many presses and where, outliers, forces, and the error to expect by cross-validation. A judgement
holds the calibration in any case: it may be wanted in spite of faults.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from skinbus.arrays import Bools, Floats
from skinbus.estimate.calibration.learning import Calibration
from skinbus.estimate.calibration.location import PLACE_SD, fit_pose
from skinbus.estimate.calibration.table import Ints, PressTable
from skinbus.estimate.calibration.validation import HeldOutErrors, cross_validate, errors_of, learn

SPARED = 0.15
"""Part of the presses that may be left out (a tenth is usual for presses by hand, and some go with them), and
of the tactels of a board that may have no press near: their gains stay as they are, and are named."""
OFF = 6.0
"""A press is an outlier when it is estimated so many times the usual error from its place, and what the
estimator says of its own, and farther than ``MAX_ERROR_M``; or so many times the usual error from its force,
and by more than a factor of e: one of ten times the force would bend the law before it stands out."""
MAX_ERROR_M, MAX_ERROR = 1e-3, 0.1
"""Errors to expect that are refused: m, and of the pitch; the larger of the two. Boards of few tactels and
coarse readings have no better places, however they are pressed."""
MAX_FORCE_ERROR = 0.3
"""Relative error of force, 68 % of the presses, beyond which forces belong to other presses."""
SUSPECT_M, BETTER = 0.5e-3, 0.6
"""m, between places and readings from which other hypotheses are looked at. One is better than those before
it when it leaves at most that part of what they leave."""
FEWEST, FEWEST_EACH = 30, 10
"""Presses of a kind of board, and of each board, or away from a tactel: fewer leave the law, gains or zeros
to chance."""
AWAY, MOST_AWAY = 0.02, 0.02
"""m, from which rubber leaves less than 1 % of a press, and the part of a strong press that tactels may read
so far away: 3 to 5 % move places by a millimetre."""
COLUMNS = {
    "s and a swapped": ((0.0, 1.0), (1.0, 0.0)),
    "the sign of a changed": ((1.0, 0.0), (0.0, -1.0)),
    **{
        f"places in {unit}, not mm": ((by, 0.0), (0.0, by))
        for unit, by in {"m": 1e3, "cm": 10.0, "inches": 25.4, "um": 1e-3}.items()
    },
}
"""What the columns s and a may be: the matrix that makes them what they should be."""
FORCES = {
    "force_n in kgf": 9.81,
    "force_n in lbf": 4.45,
    "force_n in kN": 1e3,
    "force_n in g": 9.81e-3,
    "force_n in mN, or readings in kPa": 1e-3,
    "readings that are not left-adjusted, of 12 bits in 16": 1.0 / 16.0,
}
"""Factors between the force of readings and force_n that such mistakes make."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judgement:
    """What came of presses of one kind of board.

    calibration  what was learned, without the outliers; None where nothing could be
    faults       why it must not be used, sentences
    notes        what is worth to know otherwise
    kept         (n,) False for presses that were left out
    errors       estimates of presses that the calibration was not made from; None where faults precede it
    shipped      the same by the response that the boards had
    """

    table: PressTable
    calibration: Calibration | None
    faults: list[str]
    notes: list[str]
    kept: Bools
    errors: HeldOutErrors | None = None
    shipped: HeldOutErrors | None = None

    @property
    def outliers(self) -> Ints:
        """Rows that were left out."""
        return np.flatnonzero(~self.kept)

    @property
    def place_error(self) -> float:
        """Error to expect of a place, m: 68 % of the presses have no larger one."""
        return math.nan if self.errors is None else self.errors.place(self.kept)

    @property
    def force_error(self) -> float:
        """The same of the force, as a part of it; NaN where it is not known."""
        stated = self.table.force
        return math.nan if self.errors is None or stated is None else self.errors.relative_force(stated)


def judge(table: PressTable) -> Judgement:
    """Return what can be learned from presses, how good it will be, and why it must not be used if so."""
    shipped = errors_of(table, table.arm)
    missing, notes = spread_faults(table)
    faults = [*_misplaced(table, shipped)] or [*_zero_faults(table), *missing]
    kept, learned, errors = ~_astray(table, shipped), None, None
    more = kept
    # what was learned with outliers hides some
    while more.any() and not (errors and kept.mean() < 1.0 - SPARED):
        try:
            learned = learn(table.only(kept))
        except ValueError as error:
            learned, faults = None, faults or [f"nothing can be learned: {error}"]
            break
        kept[np.flatnonzero(kept)[learned.outliers]] = False
        if faults:
            break
        errors = cross_validate(table, kept)
        more = _astray(table, errors)
        kept &= ~more
    if errors is not None:
        if kept.mean() < 1.0 - SPARED:
            faults.append(f"{(~kept).sum()} of {len(table)} presses do not go with the others")
        place, limit = errors.place(), max(MAX_ERROR_M, MAX_ERROR * table.pitch)
        faults += _force_faults(table, shipped, errors)
        if not place <= limit:
            few = "too few presses make a contact by a law from the others: too light, or more are needed"
            wrong = f"places would be wrong by {1e3 * place:.2f} mm (68 % of the presses, cross-validated)"
            faults.append(f"{wrong if math.isfinite(place) else few}; {1e3 * limit:.1f} mm are the limit")
    return Judgement(
        table=table,
        calibration=learned,
        faults=faults,
        notes=notes,
        kept=kept,
        errors=errors,
        shipped=shipped,
    )


def _misplaced(table: PressTable, shipped: HeldOutErrors) -> Iterator[str]:
    """Yield what would explain the places on each board better than the file does, as sentences.

    What the readings say by the law that the boards have is compared with what the file says under each
    hypothesis, by the median distance of the two. Outliers, up to half of the presses, do not change it.
    """
    uv, columns = table.uv(), _columns(table)
    read = uv + shipped.uv
    for p in range(table.arm.n_patches):
        rows = np.flatnonzero(np.isfinite(shipped.sd) & (table.patch == p))
        if len(rows) < FEWEST_EACH:
            continue
        tried = {"as said": uv[rows]} | {name: at[rows] for name, at in columns.items()}
        at, there = (x[rows] @ np.array([1.0, 1j]) for x in (uv, read))
        for name, own in (("the board", at), ("the board mirrored", at.conjugate())):
            x, y, turn = fit_pose(own, there, np.hypot(shipped.sd[rows], PLACE_SD)).values.tolist()
            fits = complex(x, y) + np.exp(1j * turn) * own
            tried[
                f"{name} moved by {1e3 * x:.1f}, {1e3 * y:.1f} mm in u, v and turned by "
                f"{math.degrees(turn):.0f} deg (`skinbus calibrate locate` finds boards)"
            ] = np.stack([fits.real, fits.imag], -1)
        left = {name: 1e3 * float(np.median(np.hypot(*(at - read[rows]).T))) for name, at in tried.items()}
        best = "as said"
        for name in left:
            best = name if left[name] <= BETTER * left[best] else best
        if best != "as said" and left["as said"] > 1e3 * SUSPECT_M:
            yield (
                f"the places on node {table.arm.node_label(p)} do not go with the readings; with {best} they "
                f"do: {left[best]:.1f} mm between them in place of {left['as said']:.1f} mm"
            )


def _columns(table: PressTable) -> dict[str, Floats]:
    """Return the places on boards, (n, 2) m, that the columns give if they are other ones."""
    sa, surface = np.stack([table.s, table.a], -1), table.arm.links[table.link[0]].surface
    matrices = dict(COLUMNS)
    if surface.period:
        matrices["a as an angle in degrees, not mm"] = ((1.0, 0.0), (0.0, math.radians(1e3) * surface.radius))
    places = {name: table.uv(*(sa @ np.array(matrix).T).T) for name, matrix in matrices.items()}
    return places | {"places from the middle of the board, not on the link": sa}


def _astray(table: PressTable, errors: HeldOutErrors) -> Bools:
    """Return the presses that the readings put elsewhere, or give another force, than is said of them."""
    found, off = errors.found, np.hypot(*errors.uv.T)
    if not found.any():
        return found
    out = found & (off > np.maximum(OFF * np.hypot(np.median(off[found]), errors.sd), MAX_ERROR_M))
    if table.force is not None:
        ratio = np.log(errors.force / table.force)
        differs = np.abs(ratio - np.median(ratio[found]))
        out |= found & (differs > max(1.0, OFF * float(np.median(differs[found]))))
    return np.asarray(out)


def spread_faults(table: PressTable) -> tuple[list[str], list[str]]:
    """Return what is missing, and what is not known but may be so, as sentences."""
    faults: list[str] = []
    notes: list[str] = []
    arm = table.arm
    if len(table) < FEWEST:
        faults.append(f"too few presses: {len(table)}; {FEWEST} are the least, a hundred are plenty")
    near = (table.away() < table.pitch) & np.isfinite(table.pressures)
    for p in range(arm.n_patches):
        own, node = near[table.patch == p, arm.tactels_of(p)], f"node {arm.node_label(p)}"
        healthy, n_on = arm.tactel_healthy[arm.tactels_of(p)], int(own.any(axis=1).sum())
        bare = ~own.any(axis=0) & healthy
        if n_on < FEWEST_EACH:
            faults.append(f"too few presses on {node}: {n_on}; {FEWEST_EACH} are the least")
        elif bare.any():
            some = ", ".join(map(str, (np.flatnonzero(bare) + 1).tolist()))
            (notes if bare.sum() <= SPARED * healthy.sum() else faults).append(
                f"no reading of tactel {some} of {node} of a press within {1e3 * table.pitch:.0f} mm: "
                "gains there are not known, and stay as they are; dead tactels are taken out by their bits "
                "in 0x2040 (healthy tactels) of the EDS"
            )
    return faults, notes


def _zero_faults(table: PressTable) -> Iterator[str]:
    """Yield the boards whose tactels read something of presses that are elsewhere, as sentences."""
    away = np.where(table.away() > AWAY, table.pressures, np.nan)
    for p in np.unique(table.patch).tolist():
        own, far = (x[table.patch == p, table.arm.tactels_of(p)] for x in (table.pressures, away))
        known = np.isfinite(far).sum(axis=0) >= FEWEST_EACH
        off = float(np.sqrt(np.mean(np.nanmedian(far[:, known], axis=0) ** 2))) if known.any() else 0.0
        strong = float(np.nanquantile(np.nanmax(own, axis=1, initial=0.0), 0.75))
        if off > MOST_AWAY * strong > 0.0:
            yield (
                f"tactels of node {table.arm.node_label(p)} read {1e-3 * off:.2g} kPa where no press is "
                f"near, {100 * off / strong:.0f} % of a strong press: their zeros are not taken off; add "
                "lines with force_n 0, of readings while nothing touches"
            )


def _force_faults(table: PressTable, shipped: HeldOutErrors, errors: HeldOutErrors) -> Iterator[str]:
    """Yield what is found of the forces.

    The pressures under a press add up to its force, whatever the layer, where forces and full scale are true.
    Only their ratio can be checked, and only roughly: covers that carry a part of the load, rims, or nominal
    full scales change it two or three times. The law that the boards have may know better.
    """
    if table.force is None:
        return
    load = np.nansum(np.maximum(table.pressures, 0.0), axis=1) * table.pitch**2
    judged = ((load, errors.inside & (load > 0.0)), (shipped.force, shipped.found & errors.inside))
    ratios = [float(np.median((x / table.force)[rows])) for x, rows in judged if rows.any()]
    off = min(ratios, key=lambda ratio: abs(math.log(ratio)), default=1.0)
    if decade := round(math.log10(off)):
        near = [name for name, factor in FORCES.items() if abs(math.log(off / factor)) < math.log(2.0)]
        unit = f", as by {' or by '.join(near)}" if near else ""
        yield (
            f"the pressures under a press add up to {off:.3g} times its force: forces or pressures are off "
            f"by a factor near 10^{decade}{unit}. Only the ratio of force_n and full scale "
            "in the EDS is seen here, and only within a factor of three"
        )
    error = errors.relative_force(table.force)
    if error > MAX_FORCE_ERROR:
        yield f"forces deviate by {100 * error:.0f} % from what the readings say"
