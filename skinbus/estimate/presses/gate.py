"""The gate of a calibration: what presses cannot be is refused, with what would explain them.

In the order of what spoils most: how many and where (``spread``), places against readings (``alignment``),
outliers, the pose of the board, forces, and the error to expect by cross-validation, compared with that of
the law that ships. A judgement holds the calibration in any case: it may be wanted in spite of faults.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from skinbus.estimate.calibration import Calibration
from skinbus.estimate.presses.alignment import SUSPECT, Misplacement, find_lags, find_misplaced
from skinbus.estimate.presses.cross_validation import FOLDS, HeldOutErrors, cross_validate, errors_of, learn
from skinbus.estimate.presses.forces import force_findings, uneven_forces
from skinbus.estimate.presses.pose import Pose, find_poses
from skinbus.estimate.presses.single_noise import single_noise
from skinbus.estimate.presses.spread import gaps_of, spread_faults
from skinbus.estimate.presses.table import Bools, Floats, Ints, PressTable, read_uv
from skinbus.estimate.presses.zeros import zero_faults

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
ENOUGH = 100
"""Presses by which the misfits of two hypotheses are compared."""
GOOD = 0.03
"""Error to expect, of the pitch, that is called good: what boards of rubber reach with a hundred presses."""
GOOD_FORCE = 0.05
"""The same of the force, as a part of it: what scales of 3 % leave, and no change of unit, tare or drift."""


@dataclass(frozen=True, slots=True)
class GateFinding:
    """One thing that was found, a sentence, and the rows of the table that it is about."""

    what: str
    rows: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judgement:
    """What came of presses of one kind of board.

    calibration  what was learned, without the outliers; None where nothing could be
    faults       why it must not be used
    notes        what is worth to know otherwise
    misplaced    what would explain the places better, if anything does
    outliers     (n,) rows that were left out
    errors       estimates of presses that the calibration was not made from; None where faults precede it
    shipped      the same by the response that the boards had
    poses        of each patch where its presses put it, relative to the arm file
    """

    table: PressTable
    calibration: Calibration | None
    faults: tuple[GateFinding, ...]
    notes: tuple[GateFinding, ...] = ()
    misplaced: tuple[Misplacement, ...] = ()
    outliers: Ints
    errors: HeldOutErrors | None = None
    shipped: HeldOutErrors | None = None
    poses: tuple[Pose, ...] = ()

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
    def is_good(self) -> bool:
        """Whether places will be as true as on good boards, by a law that is known at all distances."""
        learned = self.calibration
        known = learned is not None and learned.converged and not gaps_of(self.table)
        is_even = self.table.force is None or self.force_error <= GOOD_FORCE
        return known and not self.faults and is_even and self.place_error <= GOOD * pitch(self.table)

    @property
    def force_error(self) -> float:
        """The same of the force, as a part of it."""
        if self.errors is None:
            return math.nan
        stated = np.ones(len(self.table)) if self.table.force is None else self.table.force
        return self.errors.relative_force(stated, self.kept)


def judge(table: PressTable) -> Judgement:
    """Return what can be learned from presses, how good it will be, and why it must not be used if so."""
    read = read_uv(table)
    misplaced = find_misplaced(table)
    faults = _named(table, misplaced) or _slipped(table, read, SUSPECT)
    missing, unknown = spread_faults(table)
    faults = faults or [GateFinding(what) for what in (*zero_faults(table), *missing)]
    if faults:
        calibration = _try(table)
        outliers = np.zeros(0, np.intp) if calibration is None else calibration.outliers
        return Judgement(
            table=table,
            calibration=calibration,
            faults=tuple(faults),
            misplaced=tuple(misplaced),
            outliers=outliers,
        )
    judgement = _learned(table, _far(table, read))
    return replace(judgement, notes=(*map(GateFinding, unknown), *judgement.notes))


def _learned(table: PressTable, out: Bools) -> Judgement:
    """Return the judgement of presses that lie where they are said to, but for outliers."""
    for _ in range(3):  # what was learned with outliers hides some
        kept = np.flatnonzero(~out)
        part = table.only(kept)
        try:
            calibration = learn(part, maps=False)
        except ValueError as error:
            return Judgement(
                table=table,
                calibration=None,
                faults=(GateFinding(f"nothing can be learned: {error}"),),
                outliers=np.flatnonzero(out),
            )
        plain = errors_of(part, calibration.apply(table.arm))
        more = _off(part, plain)
        more[calibration.outliers] = True
        out[kept[more]] = True
        if not more.any():
            break
    plain, kept = _rows(plain, ~more), np.flatnonzero(~out)
    part = table.only(kept)
    calibration = learn(part)
    calibration = replace(calibration, noise=single_noise(part, calibration))
    out[kept[calibration.outliers]] = True
    errors = _spread_out(cross_validate(part), kept, len(table))
    shipped = _spread_out(errors_of(part, table.arm, free_scale=True), kept, len(table))
    poses = find_poses(part, plain)
    judgement = Judgement(
        table=table,
        calibration=calibration,
        faults=(),
        outliers=np.flatnonzero(out),
        errors=errors,
        shipped=shipped,
        poses=tuple(poses),
    )
    faults, notes = _faults(judgement, part, plain)
    return Judgement(
        table=table,
        calibration=calibration,
        faults=tuple(faults),
        notes=tuple(notes),
        outliers=judgement.outliers,
        errors=errors,
        shipped=shipped,
        poses=judgement.poses,
    )


def _faults(
    judgement: Judgement, part: PressTable, plain: HeldOutErrors
) -> tuple[list[GateFinding], list[GateFinding]]:
    """Return what speaks against a calibration, and what else a reader of the verdict needs."""
    table, calibration, errors = judgement.table, judgement.calibration, judgement.errors
    assert calibration is not None
    assert errors is not None
    assert judgement.shipped is not None
    faults, notes = force_findings(part, calibration, plain)
    findings = [GateFinding(what) for what in faults]
    remarks = [GateFinding(what) for what in notes]
    n, n_out = len(table), len(judgement.outliers)
    if n_out > MAX_OUTLIERS * n:
        rows = tuple(judgement.outliers.tolist())
        findings.append(GateFinding(f"{n_out} of {n} presses do not go with the others", rows))
    elif n_out:
        rows = tuple(judgement.outliers.tolist())
        remarks.append(GateFinding("left out, because they do not go with the others", rows))
    findings += [GateFinding(pose.fault) for pose in judgement.poses if pose.fault]
    remarks += [GateFinding(pose.note) for pose in judgement.poses if pose.note]
    found = part.uv() + plain.uv
    kept = np.flatnonzero(judgement.kept)
    for what, first in uneven_forces(part, plain, calibration.law.exponent):
        is_known = first is not None and len(kept) == len(part)
        remarks.append(GateFinding(what, tuple(kept[first:].tolist()) if is_known else ()))
    findings += [
        GateFinding(slip.what, tuple(kept[list(slip.rows)].tolist()))
        for slip in _slipped(part, found, 0.5 * MAX_ERROR)
        if len(kept) == len(part)
    ]
    if not calibration.converged:
        remarks.append(GateFinding("the law still changed a little when learning ended"))
    inside = errors.inside & judgement.kept
    if errors.failed:
        findings.append(
            GateFinding(
                f"in {errors.failed} of {FOLDS} choices four fifths of the presses teach no law: more are "
                "needed, in the middles of tactels and between them"
            )
        )
    unfound = float(np.mean(~errors.found[inside])) if inside.any() else float(not errors.failed)
    if unfound > MAX_UNFOUND:
        findings.append(
            GateFinding(
                f"{100 * unfound:.0f} % of the presses within the tactels make no contact: they are below "
                "the touch threshold, or nothing was pressed"
            )
        )
    if errors.misfit > MAX_MISFIT:
        findings.append(
            GateFinding(
                f"the law leaves {100 * errors.misfit:.0f} % of the readings: no press makes such readings"
            )
        )
    elif errors.misfit > judgement.shipped.misfit:
        comparison = GateFinding(
            f"the law leaves {100 * errors.misfit:.0f} % of the readings at presses not used for it; "
            f"that which the boards have leaves {100 * judgement.shipped.misfit:.0f} %"
        )
        worse = errors.misfit > max(WORSE * judgement.shipped.misfit, EXACT)
        (findings if worse else remarks).append(comparison)
    place, limit = judgement.place_error, max(MAX_ERROR_M, MAX_ERROR * pitch(table))
    before = judgement.shipped.place(judgement.kept)
    if place > SAME * before:
        remarks.append(
            GateFinding(
                f"the law that the boards have errs by {1e3 * before:.2f} mm at these presses, this one by "
                f"{1e3 * place:.2f} mm: places would not become truer by it; more presses may change that"
            )
        )
    if not place <= limit:
        findings.append(
            GateFinding(
                f"places would be wrong by {1e3 * place:.2f} mm (68 % of the presses, cross-validated); "
                f"{1e3 * limit:.1f} mm are the limit"
            )
        )
    elif place > MAX_ERROR_M:
        remarks.append(
            GateFinding(
                f"places will be wrong by more than {1e3 * MAX_ERROR_M:.0f} mm: tactels "
                f"{1e3 * pitch(table):.0f} mm apart that read in steps of {_step(table):.3g} Pa"
            )
        )
    return findings, remarks


def pitch(table: PressTable) -> float:
    """Return the pitch of the tactels of a kind of board, m."""
    return table.arm.patches[0].patch.pitch


def _step(table: PressTable) -> float:
    """Return the step of the readings of a kind of board, Pa."""
    return table.arm.patches[0].patch.transducer.resolution


def _try(table: PressTable) -> Calibration | None:
    try:
        return learn(table, maps=False)
    except ValueError:
        return None


def _named(table: PressTable, misplaced: list[Misplacement]) -> list[GateFinding]:
    """Return what would explain the places, and how much better."""
    findings = []
    for name in dict.fromkeys(found.name for found in misplaced):
        those = [found for found in misplaced if found.name == name]
        labels = ", ".join(table.arm.node_label(found.patch) for found in those)
        where = "" if len(those) == table.arm.n_patches else f" (node {labels})"
        then = table.only(np.isin(table.patch, [found.patch for found in those]))
        s, a = then.s.copy(), then.a.copy()
        for found in those:
            s[then.patch == found.patch], a[then.patch == found.patch] = found.s, found.a
        before, after = _misfit_of(then), _misfit_of(replace(then, s=s, a=a))
        findings.append(
            GateFinding(
                f"the places do not go with the readings{where}; with {name} they do: "
                f"{1e3 * those[0].after:.1f} mm between them in place of {1e3 * those[0].before:.1f} mm, "
                f"and the law leaves {100 * after:.0f} % of the readings in place of {100 * before:.0f} %"
            )
        )
    return findings


def _misfit_of(table: PressTable) -> float:
    """Return what a law learned from a table leaves of its readings; 1, all of them, where none can be."""
    if len(table) > ENOUGH:
        table = table.only(np.arange(len(table)) % math.ceil(len(table) / ENOUGH) == 0)
    learned = _try(table)
    return 1.0 if learned is None else errors_of(table, learned.apply(table.arm)).misfit


def _slipped(table: PressTable, read: Floats, least: float) -> list[GateFinding]:
    """Return the runs of rows whose readings stand in other rows."""
    findings = []
    stated = table.uv()
    for p in np.unique(table.patch):
        rows = np.flatnonzero(table.patch == p)
        step = pitch(table)
        lags = find_lags(stated[rows], read[rows], step)
        for lag in np.unique(lags[lags != 0]):
            run = np.flatnonzero(lags == lag)
            run = run[(run + lag >= 0) & (run + lag < len(rows))]
            before, after = (
                np.nanmedian(np.hypot(*(stated[rows[run]] - read[rows[run + k]]).T)) for k in (0, lag)
            )
            if len(run) > 2 and before > least * step and after < 0.6 * before:
                where = f"{abs(lag)} row{'s' if abs(lag) > 1 else ''} {'further' if lag > 0 else 'before'}"
                findings.append(
                    GateFinding(
                        f"the readings of node {table.arm.node_label(p)} have slipped: those of {len(run)} "
                        f"presses stand {where} ({1e3 * after:.1f} mm from their places in place of "
                        f"{1e3 * before:.1f} mm)",
                        tuple(rows[run].tolist()),
                    )
                )
    return findings


def _far(table: PressTable, read: Floats) -> Bools:
    """Return the presses that the readings put elsewhere altogether."""
    out = np.zeros(len(table), np.bool_)
    uv = table.uv()
    for p in np.unique(table.patch):
        rows = np.flatnonzero((table.patch == p) & np.isfinite(read[:, 0]))
        tactels = np.asarray(table.arm.patches[p].patch.tactels_uv)
        at = np.clip(uv[rows], tactels.min(axis=0), tactels.max(axis=0))
        out[rows] = np.hypot(*(at - read[rows]).T) > FAR * pitch(table)
        if table.force is not None and len(rows):
            total = np.nansum(np.maximum(table.pressures[rows], 0.0), axis=1) / table.force[rows]
            off = np.abs(np.log(np.maximum(total, 1e-300) / np.median(total)))
            out[rows] |= off > max(FAR_FORCE, OFF * float(np.median(off)))
    return out


def _off(part: PressTable, plain: HeldOutErrors) -> Bools:
    """Return the presses that are estimated far from their places, where the others are not."""
    off = np.hypot(*plain.uv.T)
    usual = np.nanmedian(off[plain.found]) if plain.found.any() else np.inf
    return np.asarray(plain.found & (off > np.maximum(OFF * np.hypot(usual, plain.sd), OFF_M)))


def _rows(errors: HeldOutErrors, rows: Bools) -> HeldOutErrors:
    return replace(
        errors,
        inside=errors.inside[rows],
        uv=errors.uv[rows],
        sd=errors.sd[rows],
        force=errors.force[rows],
    )


def _spread_out(errors: HeldOutErrors, kept: Ints, n: int) -> HeldOutErrors:
    """Return errors of some rows as those of all; NaN for the others."""
    inside, uv = np.zeros(n, np.bool_), np.full((n, 2), np.nan)
    sd, force = np.full(n, np.nan), np.full(n, np.nan)
    inside[kept], uv[kept], sd[kept], force[kept] = errors.inside, errors.uv, errors.sd, errors.force
    return HeldOutErrors(inside=inside, uv=uv, sd=sd, force=force, misfit=errors.misfit, failed=errors.failed)
