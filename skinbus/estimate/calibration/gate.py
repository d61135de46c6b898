"""The gate of a calibration: what presses cannot be is refused, with what would explain it.

In the order of what spoils most: places against what readings alone say of them, how many presses and where,
zeros, outliers, forces, and the error to expect by cross-validation, compared with that of the law that
ships. A judgement holds the calibration in any case: it may be wanted in spite of faults.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from skinbus.estimate.calibration.learning import Calibration
from skinbus.estimate.calibration.table import Bools, Floats, Ints, PressTable, read_uv
from skinbus.estimate.calibration.validation import (
    FOLDS,
    WITHIN,
    HeldOutErrors,
    cross_validate,
    errors_of,
    gaps_of,
    learn,
)
from skinbus.model import Cone, Law

MAX_OUTLIERS = 0.15
"""Part of the presses that may be left out: a tenth is usual for presses by hand, and some go with them."""
FAR = 1.2
"""Pitches between place and readings from which a press is left out before anything is learned."""
FAR_FORCE = math.log(2.5)
"""Logarithm of the factor by which the pressures of a press, per force, may differ from those of others:
beside the tactels they add up to half. One of ten times the force would bend the law before it stands out."""
OFF, OFF_M = 6.0, 1e-3
"""A press is an outlier when it is estimated so many times the usual error from its place, and
what the estimator says of its own, and so far (m)."""
MAX_ERROR_M, MAX_ERROR = 1e-3, 0.1
"""Errors to expect that are refused: m, and of the pitch; the larger of the two. Between them they are
a note: boards of few tactels and coarse readings have no better places, however they are pressed."""
MAX_SHIFT_M, MAX_SHIFT, SURE = 0.5e-3, 0.05, 4.0
"""m, or part of the pitch, and standard deviations by which all presses may deviate together."""
MAX_UNFOUND = 0.2
"""Part of the presses within the tactels that may make no contact."""
MAX_MISFIT = 0.5
"""What a law may leave of the readings, as a part of theirs: an exact law 1 %, a cone for rubber a tenth."""
WORSE = 1.2
"""Misfits, as a ratio, from which a law is worse than the one before, not the same within chance."""
EXACT = 0.02
"""What an exact law leaves of the readings: their noise, 1 to 2 %. If both leave less, both are right."""
SAME = 1.03
"""Errors to expect, as a ratio, up to which they are the same."""
GOOD = 0.03
"""Error to expect, of the pitch, that is called good: what boards of rubber reach with a hundred presses."""
GOOD_FORCE = 0.05
"""The same of the force, as a part of it: what scales of 3 % leave, and no change of unit, tare or drift."""

RIM = 0.3
"""Pitches around the tactels beyond which a place is compared as if it were there: a centroid is never."""
SUSPECT, BETTER, SHIFTED = 0.3, 0.6, 0.5
"""Places deviate from readings by a quarter of the pitch where they are true. From this part of it on other
hypotheses are looked at; one is named that leaves at most that part of the deviation, and a shift of more
than that part of the pitch: less is left to the law."""
FEWEST_COMPARED = 8
"""Presses below which medians compare nothing."""
FEWEST, FEWEST_EACH = 30, 10
"""Presses of a kind of board, and of each board: fewer leave the law, or gains, to chance."""
NEAR = 1.25
"""Pitches within which a tactel needs a press, or its gain is not known."""
MOST_BARE = 0.15
"""Part of the tactels of a board that may have none; their gains stay as they are, and are named."""
GAP = 0.35
"""Pitches: the profile of the law is not known where no press has a tactel at such distances."""
UNEVEN = "press at uneven places, as a grid repeats the same distances to the tactels"
SILENT, MOST_SILENT, FEWEST_SILENT = 0.01, 0.02, 3
"""Part of the peak, by the law that a board has, below which a press counts as not near a tactel; of a strong
press that tactels may read then: rubber leaves less than 1 %, 3 to 5 % move places by a millimetre; and
presses from which the median of what they read is known."""
FACTOR = math.sqrt(10.0)
"""By which pressures and forces may disagree: between it and its inverse lies one decade."""
MAX_FORCE_ERROR = 0.3
"""Relative error of force, 68 % of the presses, beyond which forces belong to other presses."""
MIN_RATIO = 1.3
"""Largest by smallest force from which the exponent can be checked."""
QUIET, FEWEST_QUIET = 0.1, 5
"""Part of the largest reading of a press below which a tactel shows its noise, not that of the force; presses
with such readings: with fewer the noise under presses counts, too."""

LENGTHS = {"m": 1e3, "cm": 10.0, "inches": 25.4, "um": 1e-3}
"""Factors from what was written as mm to what it was."""
FORCES = {
    "force_n in kgf": 9.81,
    "force_n in lbf": 4.45,
    "force_n in kN": 1e3,
    "force_n in g": 9.81e-3,
    "force_n in mN, or readings in kPa": 1e-3,
    "readings that are not left-adjusted, of 12 bits in 16": 1.0 / 16.0,
}
"""Factors between the pressures' sum and force_n that such mistakes make."""
BOARD = {
    "u and v swapped": ((0, 1), (1, 0)),
    "the board mirrored in u": ((-1, 0), (0, 1)),
    "the board mirrored in v": ((1, 0), (0, -1)),
    "the board turned by 180 degrees": ((-1, 0), (0, -1)),
    "the board turned by 90 degrees": ((0, -1), (1, 0)),
    "the board turned by -90 degrees": ((0, 1), (-1, 0)),
    "u and v swapped and both mirrored": ((0, -1), (-1, 0)),
}
"""How places on a board may have been taken: what to do with (u, v)."""


class GateFinding(NamedTuple):
    """One thing that was found, a sentence, and the rows of the table that it is about."""

    what: str
    rows: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judgement:
    """What came of presses of one kind of board.

    calibration  what was learned, without the outliers; None where nothing could be
    faults       why it must not be used
    notes        what is worth to know otherwise
    outliers     (n,) rows that were left out
    errors       estimates of presses that the calibration was not made from; None where faults precede it
    shipped      the same by the response that the boards had
    is_shifted   whether all presses deviate by the same step: the boards lie elsewhere, or the presses
    """

    table: PressTable
    calibration: Calibration | None
    faults: tuple[GateFinding, ...]
    notes: tuple[GateFinding, ...] = ()
    outliers: Ints
    errors: HeldOutErrors | None = None
    shipped: HeldOutErrors | None = None
    is_shifted: bool = False

    @property
    def kept(self) -> Bools:
        """(n,) False for outliers."""
        kept = np.ones(len(self.table), np.bool_)
        kept[self.outliers] = False
        return kept

    @property
    def place_error(self) -> float:
        """Error to expect of a place, m: 68 % of the presses have no larger one."""
        return math.nan if self.errors is None else self.errors.place(self.kept)

    @property
    def force_error(self) -> float:
        """The same of the force, as a part of it."""
        return math.nan if self.errors is None else self.errors.relative_force(self.table.forces)

    @property
    def is_good(self) -> bool:
        """Whether places will be as true as on good boards, by a law that is known at all distances."""
        learned = self.calibration
        known = learned is not None and learned.converged and not gaps_of(self.table)
        is_even = self.table.force is None or self.force_error <= GOOD_FORCE
        return known and not self.faults and is_even and self.place_error <= GOOD * self.table.pitch


def judge(table: PressTable) -> Judgement:
    """Return what can be learned from presses, how good it will be, and why it must not be used if so."""
    read = read_uv(table)
    missing, unknown = spread_faults(table)
    faults = _misplaced(table, read) or [*_zero_faults(table), *missing]
    out = _far(table, read)
    try:
        if faults:
            learned = learn(table, maps=False)
            outliers = learned.outliers
        else:
            learned, plain = _without_outliers(table, out)
            outliers = np.flatnonzero(out)
    except ValueError as error:
        faults = faults or [f"nothing can be learned: {error}"]
        return Judgement(
            table=table, calibration=None, faults=_findings(faults), outliers=np.zeros(0, np.intp)
        )
    judgement = Judgement(table=table, calibration=learned, faults=_findings(faults), outliers=outliers)
    if faults:
        return judgement
    kept = judgement.kept
    judgement = replace(
        judgement,
        errors=cross_validate(table, kept),
        shipped=errors_of(table, table.arm, kept, free_scale=True),
    )
    return _judged(judgement, learned, plain, [GateFinding(what) for what in unknown])


def _findings(what: list[str]) -> tuple[GateFinding, ...]:
    return tuple(map(GateFinding, what))


def _without_outliers(table: PressTable, out: Bools) -> tuple[Calibration, HeldOutErrors]:
    """Return what is learned without outliers, added to ``out``, and the errors of a law without a map."""
    for _ in range(3):  # what was learned with outliers hides some
        kept = np.flatnonzero(~out)
        learned = learn(table.only(kept), maps=False)
        found = errors_of(table, learned.apply(table.arm), ~out)
        off = np.hypot(*found.uv.T)
        usual = np.nanmedian(off[found.found]) if found.found.any() else np.inf
        more = found.found & (off > np.maximum(OFF * np.hypot(usual, found.sd), OFF_M))
        more[kept[learned.outliers]] = True
        out |= more
        if not more.any():
            break
    kept = np.flatnonzero(~out)
    learned = learn(table.only(kept))
    out[kept[learned.outliers]] = True
    return replace(learned, noise=single_noise(table.only(kept), learned)), found


def _judged(
    judged: Judgement, learned: Calibration, plain: HeldOutErrors, notes: list[GateFinding]
) -> Judgement:
    """Return a judgement with what speaks against it, and what else a reader of the verdict needs."""
    table, errors, shipped, kept = judged.table, judged.errors, judged.shipped, judged.kept
    assert errors is not None
    assert shipped is not None
    faults: list[GateFinding] = []

    def found(what: str, *, is_fault: bool = True, rows: Ints | None = None) -> None:
        of = () if rows is None else tuple(rows.tolist())
        (faults if is_fault else notes).append(GateFinding(what, of))

    n, n_out = len(table), len(judged.outliers)
    if n_out:
        many = n_out > MAX_OUTLIERS * n
        few = "left out, because they do not go with the others"
        words = f"{n_out} of {n} presses do not go with the others" if many else few
        found(words, is_fault=many, rows=judged.outliers)
    for what, is_fault in _force_findings(table.only(kept), learned, errors.relative_force(table.forces)):
        found(what, is_fault=is_fault)
    shifts = list(_shifts(table, plain))
    for what in shifts:
        found(what)
    if not learned.converged:
        found("the law still changed a little when learning ended", is_fault=False)
    if errors.failed:
        found(
            f"in {errors.failed} of {FOLDS} choices four fifths of the presses teach no law: more are "
            "needed, in the middles of tactels and between them"
        )
    unfound = (
        float(np.mean(~errors.found[errors.inside])) if errors.inside.any() else float(not errors.failed)
    )
    if unfound > MAX_UNFOUND:
        found(
            f"{100 * unfound:.0f} % of the presses within the tactels make no contact: they are below "
            "the touch threshold, or nothing was pressed"
        )
    if errors.misfit > MAX_MISFIT:
        found(f"the law leaves {100 * errors.misfit:.0f} % of the readings: no press makes such readings")
    elif errors.misfit > shipped.misfit:
        found(
            f"the law leaves {100 * errors.misfit:.0f} % of the readings at presses not used for it; "
            f"that which the boards have leaves {100 * shipped.misfit:.0f} %",
            is_fault=errors.misfit > max(WORSE * shipped.misfit, EXACT),
        )
    place, limit, before = judged.place_error, max(MAX_ERROR_M, MAX_ERROR * table.pitch), shipped.place(kept)
    if place > SAME * before:
        found(
            f"the law that the boards have errs by {1e3 * before:.2f} mm at these presses, this one by "
            f"{1e3 * place:.2f} mm: places would not become truer by it; more presses may change that",
            is_fault=False,
        )
    if not place <= limit:
        found(
            f"places would be wrong by {1e3 * place:.2f} mm (68 % of the presses, cross-validated); "
            f"{1e3 * limit:.1f} mm are the limit"
        )
    elif place > MAX_ERROR_M:
        found(
            f"places will be wrong by more than {1e3 * MAX_ERROR_M:.0f} mm: tactels "
            f"{1e3 * table.pitch:.0f} mm apart that read in steps of "
            f"{table.arm.patches[0].patch.transducer.resolution:.3g} Pa",
            is_fault=False,
        )
    return replace(judged, faults=tuple(faults), notes=tuple(notes), is_shifted=bool(shifts))


def _misplaced(table: PressTable, read: Floats) -> list[str]:
    """Return what would explain the places of each patch better than the file does.

    What readings alone say of the place needs no calibration. It is compared with what the file says under
    each hypothesis: the median distance of the two is a fraction of the pitch where the hypothesis is true,
    and that of random places where it is not. Outliers, up to half of the presses, do not change a median.
    """
    said: dict[str, list[tuple[str, float, float]]] = {}
    for p in np.unique(table.patch).tolist():
        rows = np.flatnonzero((table.patch == p) & np.isfinite(read[:, 0]))
        uv, pitch = np.asarray(table.arm.patches[p].patch.tactels_uv), table.pitch
        low, high = uv.min(axis=0) - RIM * pitch, uv.max(axis=0) + RIM * pitch
        given, before = table.uv()[rows], 0.0
        shift = np.median(read[rows] - given, axis=0) if len(rows) else np.zeros(2)
        tried = [*_hypotheses(table, p, rows)]
        if np.hypot(*shift) > SHIFTED * pitch:
            by = f"a shift by {1e3 * shift[0]:.1f} mm in u and {1e3 * shift[1]:.1f} mm in v"
            tried.append((by, given + shift))
        name, after = "", math.inf
        for one, at in tried if len(rows) >= FEWEST_COMPARED else ():
            left = float(np.median(np.hypot(*(np.clip(at, low, high) - read[rows]).T)))
            if not one:
                before = left
            elif left < 0.8 * after:  # the first wins among those that fit about as well
                name, after = one, left
        if before < SUSPECT * pitch:
            continue
        if after <= BETTER * before:
            said.setdefault(name, []).append((table.arm.node_label(p), before, after))
    findings = []
    for name, boards in said.items():
        labels, before, after = ", ".join(label for label, *_ in boards), *boards[0][1:]
        where = "" if len(boards) == table.arm.n_patches else f" (node {labels})"
        findings.append(
            f"the places do not go with the readings{where}; with {name} they do: {1e3 * after:.1f} mm "
            f"between them in place of {1e3 * before:.1f} mm"
        )
    return findings


def _hypotheses(table: PressTable, p: int, rows: Ints) -> Iterator[tuple[str, Floats]]:
    """Yield names, "" for the file as it is, and the places on a board that they imply, (n, 2) m."""
    arm, placed = table.arm, table.arm.patches[p]
    sa, surface = np.stack([table.s[rows], table.a[rows]], -1), arm.links[placed.link].surface
    swap, chart = np.array([[0, 1], [1, 0]]), {"": np.eye(2)}
    chart |= {f"places in {unit}, not mm": factor * np.eye(2) for unit, factor in LENGTHS.items()}
    chart["s and a swapped"] = swap
    for unit, factor in LENGTHS.items():
        chart[f"s in {unit}, not mm"] = np.diag([factor, 1.0])
        chart[f"a in {unit}, not mm"] = np.diag([1.0, factor])
    if surface.period:
        for unit, factor in {"degrees": math.radians(1e3), "rad": 1e3}.items():
            chart[f"a as an angle in {unit}, not mm"] = np.diag([1.0, factor * surface.radius])
    chart["the sign of a changed"] = np.diag([1.0, -1.0])
    for name, matrix in chart.items():
        yield name, arm.on_board(p, *(sa @ matrix.T).T)
    for name, turn in BOARD.items():
        yield name, arm.on_board(p, *sa.T) @ np.array(turn).T
    yield "places from the middle of the board, not on the link", sa


def _shifts(table: PressTable, plain: HeldOutErrors) -> Iterator[str]:
    """Yield where the presses of a board deviate together: a law that is radial about tactels cannot hide it.

    plain: errors by a law without a map, which can
    """
    for p in np.unique(table.patch).tolist():
        rows = (table.patch == p) & plain.found
        if rows.sum() < FEWEST_COMPARED:
            continue
        at, off = table.uv()[rows] @ [1.0, 1j], plain.uv[rows] @ [1.0, 1j]
        at, shift = at - at.mean(), complex(np.median(off.real), np.median(off.imag))
        size2 = float(np.vdot(at, at).real)
        turn = float(np.vdot(at, off).imag) / size2
        spread = 1.2 * float(np.median(np.abs(off - shift - 1j * turn * at)))
        sd, limit = spread / math.sqrt(len(at)), max(MAX_SHIFT_M, MAX_SHIFT * table.pitch)
        rim = math.sqrt(2.0 * size2 / len(at))
        if abs(shift) > max(limit, SURE * sd) or rim * abs(turn) > max(2.0 * limit, SURE * sd):
            yield (
                f"the readings of node {table.arm.node_label(p)} lie {1e3 * shift.real:+.2f} mm in u and "
                f"{1e3 * shift.imag:+.2f} mm in v (sd {1e3 * sd:.2f} mm) from where the presses are said to "
                f"be, turned by {math.degrees(turn):+.1f} degrees: either these places or that of the board "
                "in the arm file are wrong"
            )


def _far(table: PressTable, read: Floats) -> Bools:
    """Return the presses that the readings put elsewhere altogether."""
    out, uv = np.zeros(len(table), np.bool_), table.uv()
    for p in np.unique(table.patch):
        rows = np.flatnonzero((table.patch == p) & np.isfinite(read[:, 0]))
        if not len(rows):
            continue
        tactels = np.asarray(table.arm.patches[p].patch.tactels_uv)
        at = np.clip(uv[rows], tactels.min(axis=0), tactels.max(axis=0))
        total = np.nansum(np.maximum(table.pressures[rows], 0.0), axis=1) / table.forces[rows]
        off = np.abs(np.log(np.maximum(total, 1e-300) / np.median(total)))
        out[rows] = np.hypot(*(at - read[rows]).T) > FAR * table.pitch
        if table.force is not None:
            out[rows] |= off > max(FAR_FORCE, OFF * float(np.median(off)))
    return out


def spread_faults(table: PressTable) -> tuple[list[str], list[str]]:
    """Return what is missing, and what is not known but may be so, as sentences."""
    faults: list[str] = []
    notes: list[str] = []
    arm, d = table.arm, table.away() / table.pitch
    if len(table) < FEWEST:
        faults.append(f"{len(table)} presses are too few; {FEWEST} are the least, a hundred are plenty")
    for p in range(arm.n_patches):
        here, node = arm.tactels_of(p), f"node {arm.node_label(p)}"
        near, healthy = d[table.patch == p, here] < NEAR, np.asarray(arm.tactel_healthy[here])
        n_on = int(near.any(axis=1).sum())
        if n_on < FEWEST_EACH:
            faults.append(f"{n_on} presses on {node} are too few; {FEWEST_EACH} are the least")
            continue
        unread = ~np.isfinite(table.own(p)).any(axis=0) & healthy
        bare = ~near.any(axis=0) & healthy
        for which, before, after in (
            (
                unread,
                "no reading",
                "not calibrated, gains stay as they are; dead ones are taken out by their bits in 0x2040 "
                "(healthy tactels) of the EDS",
            ),
            (bare, f"no press within {1e3 * NEAR * table.pitch:.0f} mm", "gains there are not known"),
        ):
            if which.any():
                names = (np.flatnonzero(which) + 1).tolist()
                some = ", ".join(map(str, names[:10])) + (" and others" if len(names) > 10 else "")
                enough = which.sum() <= MOST_BARE * healthy.sum()
                (notes if enough else faults).append(f"{before} of tactel {some} of {node}: {after}")
    near = np.sort(np.concatenate([[0.0], d[d <= WITHIN], [WITHIN]]))
    widest = int(np.diff(near).argmax())
    if near[widest + 1] - near[widest] > GAP:
        where = "between" if widest else "on"
        faults.append(
            f"no press has a tactel at {near[widest]:.1f} to {near[widest + 1]:.1f} pitches: the law is not "
            f"known there; press {where} the tactels, too"
        )
    gaps = [] if faults else gaps_of(table)
    if gaps:
        where = ", ".join(f"{1e3 * low:.1f} to {1e3 * high:.1f}" for low, high in gaps)
        notes.append(
            f"no press has a tactel at distances of {where} mm: there the law is drawn, not measured; "
            f"{UNEVEN}"
        )
    return faults, notes


def _zero_faults(table: PressTable) -> list[str]:
    """Return the boards whose tactels read something of presses that are elsewhere, as sentences."""
    faults, d = [], table.away()
    force = np.median(table.forces)
    for p in np.unique(table.patch).tolist():
        own, law = table.own(p), table.arm.patches[p].patch.law
        peak = law.pressure(np.zeros(1), force)
        share = np.abs(law.pressure(d[table.patch == p, table.arm.tactels_of(p)], force)) / peak
        away = np.where(share < SILENT, own, np.nan)
        known = np.isfinite(away).sum(axis=0) >= FEWEST_SILENT
        off = float(np.sqrt(np.mean(np.nanmedian(away[:, known], axis=0) ** 2))) if known.any() else 0.0
        strong = float(np.nanquantile(np.nanmax(own, axis=1, initial=0.0), 0.75))
        if off > MOST_SILENT * strong > 0.0:
            faults.append(
                f"tactels of node {table.arm.node_label(p)} read {1e-3 * off:.2g} kPa where no press is "
                f"near, {100 * off / strong:.0f} % of a strong press: their zeros are not taken off; add "
                "lines with force_n 0, of readings while nothing touches"
            )
    return faults


def _force_findings(table: PressTable, learned: Calibration, error: float) -> Iterator[tuple[str, bool]]:
    """Yield what is found of the forces, and whether it is a fault.

    The pressures under a press add up to its force, whatever the layer: the integral of the law over the
    surface is 1 in N/N where forces and full scale are true. Only their ratio can be checked, and only
    roughly: covers that carry a part of the load, or nominal full scales, change it two or three times.
    """
    if table.force is None:
        yield "forces are not known: nothing of them can be checked", False
        return
    typical = float(np.exp(np.mean(np.log(table.force))))
    ratio = _load_ratio(learned.law, typical)
    usual = float(np.median([_load_ratio(placed.patch.law, typical) for placed in table.arm.patches]))
    off = min((ratio, ratio / usual), key=lambda x: abs(math.log(x)))
    if not 1.0 / FACTOR <= off <= FACTOR:
        near = [name for name, factor in FORCES.items() if abs(math.log(off / factor)) < math.log(2.0)]
        unit = f", as by {' or by '.join(near)}" if near else ""
        yield (
            f"the pressures under a press add up to {ratio:.3g} times its force, by the law that the boards "
            f"have to {usual:.2g}: forces or pressures are off by a factor near 10^{round(math.log10(off))}"
            f"{unit}. Only the ratio of force_n and the full scale in the EDS is seen here, and only "
            "within a factor of three",
            True,
        )
    if error > MAX_FORCE_ERROR:
        yield f"forces deviate by {100 * error:.0f} % from what the readings say", True
    if table.force.max() < MIN_RATIO * table.force.min():
        yield "all forces are about the same: the law is taken to be linear in the force", False
    elif not 0.5 <= learned.law.exponent <= 1.6:
        yield (
            f"pressures grow as force^{learned.law.exponent:.2f}, as under no cover: "
            "are the forces those of the presses?",
            True,
        )


def _load_ratio(law: Law, force: float) -> float:
    """Return the integral of the pressures of a press over the plane, by its force (N)."""
    effective = force**law.exponent
    if isinstance(law, Cone):
        return float(effective / force)
    d = np.linspace(0.0, law.step * (len(law.table) - 1), 1000)
    return float(max(effective / force * np.trapezoid(2.0 * np.pi * d * law.profile(d), d), 1e-12))


def single_noise(table: PressTable, learned: Calibration) -> Floats:
    """Return the noise of a single reading, (n_tactels,) Pa of true pressure.

    A calibration learns the noise of the readings it is made from. Means have less than what an estimator
    gets, cycle by cycle: with a noise half as large as it is, an arm on which nothing presses finds contacts.
    So it is what the file says, else what was learned from single readings; of means of which nothing is
    known it is at least what the board declares.
    """
    otherwise = learned.noise
    if not table.are_single:
        otherwise = np.maximum(learned.noise, np.asarray(table.arm.tactel_noise))
    if table.noise is None:
        return otherwise
    given = np.isfinite(table.noise) & np.isfinite(table.pressures)
    most = np.nanmax(table.pressures, axis=1, keepdims=True, initial=0.0)
    quiet = given & (np.abs(np.nan_to_num(table.pressures)) < QUIET * most)
    use = np.where(quiet.sum(axis=0) >= FEWEST_QUIET, quiet, given)
    square = (np.where(use, table.noise, 0.0) ** 2).sum(axis=0) / np.maximum(use.sum(axis=0), 1)
    # as given in the unit of the arm's gains; the learned ones take their place
    gain = np.asarray(learned.gain) / np.asarray(table.arm.tactel_gain)
    return np.asarray(np.where(given.any(axis=0), np.sqrt(square) * gain, otherwise))
