"""Calibration: the response of a skin from presses at known places and forces.

The model of reading j in press i, at distance d_ij from it::

    p_ij = c_j F_i^e k(d_ij / w_j) + o_j + error,    var(error) = noise_j^2 + (c_j F_i^e m(d_ij))^2

with gain c, width w and offset o of each tactel, drawn to 1, 1 and 0 by what real arrays scatter by, so that
a tactel of which presses say little keeps the shared profile. Place and force of a press err alike in all of
its readings, so they are unknowns, too, drawn to what was said; by how much all these are drawn the presses
refine. k is a table smoothed by a penalty on its third differences, whose weight generalised cross-validation
chooses; m, the misfit, is a profile over the distance: a law is most wrong where it predicts next to nothing.

Gauss-Newton improves law, tactels and presses in turn; between its steps the variances are estimated anew,
Huber's weights hold large residuals back, and presses that deviate far more than others are left out. What
the law leaves may belong to a smooth map (:mod:`.residual_map`). Calibration runs once, at a desk: numpy,
not kernels.

Assumption: fewer than a tenth of the presses are outliers.
Source: P. Craven, G. Wahba, Smoothing noisy data with spline functions (1979), doi:10.1007/BF01404567;
P. Huber, Robust Statistics (1981), 7.8, for weights by residuals; S. Van Huffel, P. Lemmerling, Total Least
Squares and Errors-in-Variables Modeling (2002), for presses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline, PPoly
from scipy.sparse import csr_array

from skinbus.arrays import Bools, Floats
from skinbus.estimate.calibration.residual_map import MAP_REACH, MAP_STEP, residual_maps
from skinbus.estimate.kernels.layout import limit_of, step_of
from skinbus.model import Arm, Radial, ResidualMap

Ints = npt.NDArray[np.intp]

POINTS = 64
"""Points of the table: what the EDS of a patch holds."""
REACH = 0.030
"""Distance at which the table ends at first, m: five times the usual thickness of a cover."""
STEP = REACH / (POINTS - 1)
"""m, of the table."""
TRIM = 0.002
"""The table is cut where k stays below this part of its peak: a fifth of the usual noise of 1 %."""
MIN_FORCE_RATIO = 1.3
"""The exponent is learned when the largest force is so many times the smallest; else it is 1."""
MIN_READINGS = 20
"""Fewer usable readings than this cannot carry a profile, or a point of the misfit."""
ROUNDS, MAX_ROUNDS = 12, 60
"""Rounds in which variances, outliers and the penalty are chosen anew, and all: with weights that stay it is
least squares, which converges, where no radial law is true, too."""
SETTLED = 3
"""Rounds after which presses move and outliers are looked for: before, the profile is not one."""
TOLERANCE = 1e-4
"""Of the largest pressure, by which the last round changes readings: a tenth of what they resolve."""

TACTEL_SD = (0.1, 0.04, 0.003)
"""Prior standard deviations of a tactel's gain and width (logarithms) and offset (of the peak): those of real
arrays."""
FORCE_SD = 0.02
"""Standard deviation of the force of a press, as a part of it: a load cell, or a weight on a guided tip."""
SAID, MOST_SD = 10.0, 3.3
"""Presses, or tactels, that weigh as much as the standard deviations said when they are refined, and how many
times those they become at most: presses that err by more than 1 mm are not moved to where they fit."""
FAR = 0.5
"""Part of the readings, by distance from a press, beyond which they show the noise."""
LOUD = 0.2
"""Part of the largest pressure above which a reading shows the misfit that is reported."""
MOST_LEVERAGE = 0.9
"""Part of a reading's variance that unknowns take up, at most."""
BINS = 16
"""Of the misfit over the distance: 2 mm each."""
HUBER, CLIP = 2.5, 4.0
"""Standard deviations from which a residual counts less than its square, and to which residuals are cut where
variances are estimated."""
OUTLIER, OUTLIER_SHARE = 3.3, 0.1
"""A press is an outlier when the root mean square of its residuals is so many times the median of all
presses: one displaced by 5 mm has 4 to 200 times, the worst of 1600 good ones 3 times. At most this share
is."""
TRUEST, FIRST = 1e-3, 0.05
"""Parts of the largest reading: the best of laws leaves the one, so that no reading weighs more for being
truer or is an outlier for less than multiples of it; and errors are taken to be the other at first."""
LEFT_BY_MAP = 0.1
"""Part of the misfit that stays under a map of residuals: between presses it predicts less well than at
them."""
WEIGHTS = np.logspace(-2.0, 3.0, 11)
"""Weights of the penalty that are tried, relative to the information of the readings. With smaller ones a
table follows readings no closer, but errors of few presses or of rounding made them be chosen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """What was learned; ``apply`` puts it into an arm.

    law          the radial law with its misfit; in units of the force of the presses where that is not known
    gain         (n_tactels,) factor from indicated to true pressure, to be used in place of the arm's
    width        (n_tactels,) how much wider each tactel's response is than the law
    bias         (n_tactels,) Pa of true pressure, what each tactel reads too much
    noise        (n_tactels,) standard deviation of a reading, Pa of true pressure
    residual_map (n_tactels, points, points) of values, or None where no smooth map predicts new presses
    residual     root mean square of the weighted residuals; near 1 when the model explains the readings
    n_readings   readings that were used
    outliers     (n,) presses that deviate far more than the others and were left out
    converged    whether the rounds converged; law.misfit is how true the law is
    """

    law: Radial
    gain: Floats
    width: Floats
    bias: Floats
    noise: Floats
    residual_map: ResidualMap | None
    residual: float
    n_readings: int
    outliers: Ints
    converged: bool

    def apply(self, arm: Arm) -> Arm:
        """Return the arm with this response and this noise."""
        patches = [
            replace(placed, patch=replace(placed.patch, **self.of(arm.tactels_of(p))))
            for p, placed in enumerate(arm.patches)
        ]
        return Arm(arm.name, arm.links, patches, *arm.buses, robot=arm.robot)

    def of(self, tactels: slice) -> dict[str, Any]:
        """Return the response of the tactels of a patch, as :class:`skinbus.model.Patch` names it."""
        own = self.residual_map
        columns = {name: getattr(self, name)[tactels].copy() for name in ("gain", "width", "bias", "noise")}
        part = None if own is None else ResidualMap(own.step, own.values[tactels].copy())
        return columns | {"law": self.law, "residual_map": part}


def learn_radial_law(
    arm: Arm,
    s: npt.ArrayLike,
    a: npt.ArrayLike,
    force: npt.ArrayLike | None,
    pressures: npt.ArrayLike,
    *,
    link: npt.ArrayLike = 0,
    place_sd: float = 0.0,
    maps: bool = True,
) -> Calibration:
    """Return the response of a skin, learned from presses at known places.

    Args:
        arm: the skin, with the gains that it has now.
        s: (n_presses,) m, places of the presses along their link.
        a: (n_presses,) m, places across or around it.
        force: (n_presses,) N; None when it is not known, but the same in all of them.
        pressures: (n_presses, n_tactels) Pa, as the arm's present gains give them; NaN for a missing reading.
            Readings at full scale and those of dead tactels are left out.
        link: (n_presses,) or one number.
        place_sd: standard deviation of s and a as they are said, m; readings correct them. 0: they are exact.
        maps: whether to try for a map of residuals, which takes most of the time.

    Raises:
        ValueError: shapes that do not fit, forces that are not positive, or too few readings to learn from.
    """
    s, a = (np.atleast_1d(np.asarray(x, np.float64)) for x in (s, a))
    table = np.atleast_2d(np.asarray(pressures, np.float64))
    n = len(s)
    if table.shape != (n, arm.n_tactels) or a.shape != (n,):
        wanted = f"({n},) and ({n}, {arm.n_tactels})"
        raise ValueError(f"a and pressures must have shapes {wanted}, got {a.shape} and {table.shape}")
    forces = np.broadcast_to(np.asarray(1.0 if force is None else force, np.float64), n)
    if not (np.isfinite(forces) & (forces > 0.0)).all():
        raise ValueError("forces must be finite and positive")
    fit = _Fit(arm, np.broadcast_to(link, n), s, a, forces, table, place_sd)
    converged = False
    for k in range(MAX_ROUNDS):
        before = fit.prediction
        fit.improve(choose=k < ROUNDS, move=k >= SETTLED and place_sd > 0.0)
        if k < ROUNDS:
            if k >= SETTLED:
                fit.find_outliers()
            fit.find_variances(fit.residuals)
        change = np.abs(fit.prediction - before).max()
        converged = bool(change < TOLERANCE * np.abs(fit.prediction).max())
        if converged:
            break
    values = fit.find_maps(arm) if maps else None
    log_gain, width, offset = fit.tactels.values.T
    # the mean response of the tactels that were read is 1
    common = float(np.exp(log_gain[fit.tactels.known]).mean())
    gain, to_newtons = np.exp(log_gain) / common, common * math.exp(-fit.exponent * fit.middle)
    left = fit.residuals[fit.kept] ** 2 / fit.variance[fit.kept]
    return Calibration(
        law=fit.law(to_newtons, has_map=values is not None),
        gain=arm.tactel_gain / gain,
        width=np.exp(width),
        bias=offset / gain,
        noise=fit.noise / gain,
        residual_map=None if values is None else ResidualMap(MAP_STEP, values * to_newtons),
        residual=float(np.sqrt(left.mean())),
        n_readings=int(fit.kept.sum()),
        outliers=np.flatnonzero(fit.outlier),
        converged=converged,
    )


class _Unknowns:
    """Unknowns (n, k) of tactels or presses, drawn to 0 by standard deviations that all of them refine."""

    def __init__(self, owner: Ints, n: int, said: Any) -> None:
        ones = np.ones(len(owner))
        self.owner = owner
        """(n_readings,) whose each reading is."""
        self.sum: Any = csr_array((ones, (owner, np.arange(len(owner)))), (n, len(owner)))
        """Matrix that sums readings by owner."""
        self.values, self.taken_up = np.zeros((n, len(said))), 0.0 * ones
        """The unknowns, and what they take up of the variance of each reading, as a part of it."""
        self._said = self._sd = np.asarray(said, np.float64)
        self.count = self.sum @ ones
        """(n,) readings of each."""
        self.known = self.count > 0.0

    def step(self, slopes: Floats, residuals: Floats, trust: Floats, *, refine: bool) -> Floats:
        """Take a Gauss-Newton step; return the mean of all (k,), which is taken off.

        slopes: (n_readings, k); trust: (n_readings,) inverse variances
        """
        k = len(self._said)
        weighted = trust[:, None] * slopes
        normal = (self.sum @ (weighted[:, :, None] * slopes[:, None]).reshape(-1, k * k)).reshape(-1, k, k)
        covariance = np.linalg.inv(normal + np.diag(self._sd**-2.0))
        pull = self.sum @ (weighted * residuals[:, None]) - self.values / self._sd**2
        values = self.values + np.einsum("kij,kj->ki", covariance, pull)
        # what is common to all belongs to the law
        common = values[self.known].mean(axis=0)
        self.values = (values - common) * self.known[:, None]
        self.variance = np.einsum("kii->ki", covariance)[self.known].mean(axis=0)
        """Mean of what readings leave of each."""
        self.taken_up = np.einsum("ri,rij,rj->r", weighted, covariance[self.owner], slopes)
        if refine:
            square = (self.values**2 + np.einsum("kii->ki", covariance))[self.known] / self._said**2
            ratio = (square.sum(axis=0) + SAID) / (len(square) + SAID)
            self._sd = self._said * np.minimum(np.sqrt(ratio), MOST_SD)
        return np.asarray(common)


class _Fit:
    """Usable readings, one row each; the unknowns, and what improves them."""

    def __init__(
        self, arm: Arm, link: Any, s: Floats, a: Floats, force: Floats, pressures: Floats, place_sd: float
    ) -> None:
        away = np.full(pressures.shape, np.inf + 0j)
        for p, placed in enumerate(arm.patches):
            rows, here = np.flatnonzero(link == placed.link), arm.tactels_of(p)
            off = arm.on_board(p, s[rows], a[rows])[:, None] - placed.patch.tactels_uv
            away[rows, here] = off @ (1.0, 1j) * np.exp(1j * placed.yaw)
        near = np.isfinite(pressures) & (np.abs(away) < REACH)
        usable = near & arm.tactel_healthy & (pressures < limit_of(arm))
        if usable.sum() < MIN_READINGS:
            raise ValueError(
                f"only {usable.sum()} usable readings within {1e3 * REACH:g} mm of a press; "
                f"{MIN_READINGS} needed"
            )
        self._p, self._away = pressures[usable], away[usable]
        if not (self._p > 0.0).any():
            raise ValueError("no reading is above zero: were the places pressed at all?")
        press, tactel = np.nonzero(usable)
        log_force, peak = np.log(force)[press], float(np.abs(self._p).max())
        self.middle = float(log_force.mean())
        """Logarithm of the geometric mean of the forces."""
        self._log_force = log_force - self.middle
        self._learns_exponent = force.max() >= MIN_FORCE_RATIO * force.min()
        # the standard deviation that rounding alone gives a reading, Pa
        self._floor = np.maximum(step_of(arm) / math.sqrt(12.0), 1e-9 * peak)
        self._unmatched = (TRUEST * peak) ** 2
        self.table, self.exponent = np.zeros(POINTS - 1), 1.0
        self.tactels = _Unknowns(tactel, arm.n_tactels, np.array(TACTEL_SD) * (1.0, 1.0, peak))
        """Logarithms of gain and width, offset (Pa)."""
        self.presses = _Unknowns(press, len(s), (place_sd or 1.0, place_sd or 1.0, FORCE_SD))
        """What they are off by along s and a (m), and in the logarithm of the force."""
        self._misfit_profile, self._weight = np.zeros(BINS), float(WEIGHTS[0])
        self.variance = np.full(len(self._p), (FIRST * peak) ** 2)
        self.outlier = np.zeros(len(s), np.bool_)
        self._predict()

    @property
    def kept(self) -> Bools:
        """Whether a row belongs to a press that is no outlier."""
        return ~self.outlier[self.presses.owner]

    @property
    def residuals(self) -> Floats:
        """Reading minus model, row by row (Pa)."""
        return np.asarray(self._p - self.prediction)

    def _predict(self, *, moved: bool = True) -> None:
        """Follow the unknowns: readings that the model gives, row by row (Pa), and their slopes.

        ``moved``: places or widths may have changed.
        """
        gain, width, self._offset = self.tactels.values[self.tactels.owner].T
        off_s, off_a, off_force = self.presses.values[self.presses.owner].T
        if moved:
            self.away = self._away + off_s + 1j * off_a
            self.d = np.abs(self.away)
            at = self.d / np.exp(width)
            self._basis, self._slopes = _matrix(_PROFILES, at), _matrix(_SLOPES, at)
        self.amplitude = np.exp(gain + self.exponent * self._log_force + off_force)
        """Gain of the tactel times effective force."""
        self.pressed = self.amplitude * (self._basis @ self.table)
        self.prediction = self.pressed + self._offset
        self._by_distance = self.amplitude * (self._slopes @ self.table) / (STEP * np.exp(width))

    def improve(self, *, choose: bool, move: bool) -> None:
        """Take a step in the law, then in tactels and, to ``move`` them, in presses.

        ``choose``: weights, the penalty and the standard deviations of unknowns follow what is found.
        """
        if choose:
            # the inverse variance, less for large residuals, 0 for outliers
            variance = self.variance + self._unmatched
            off = np.abs(self.residuals) / np.sqrt(variance) if self.table.any() else 0.0 * self._p
            self._trust = self.kept * (HUBER / np.maximum(off, HUBER)) / variance
        self._fit_law(choose=choose)
        self._predict(moved=False)
        slopes = np.column_stack([self.pressed, -self.d * self._by_distance, np.ones(len(self._p))])
        common = self.tactels.step(slopes, self.residuals, self._trust, refine=choose)
        self.table = self.table * math.exp(common[0])
        self._predict()
        if move:
            towards = self._by_distance * self.away / np.maximum(np.abs(self.away), 1e-9)
            slopes = np.column_stack([towards.real, towards.imag, self.pressed])
            self.presses.step(slopes, self.residuals, self._trust, refine=choose)
            self._predict()

    def _fit_law(self, *, choose: bool) -> None:
        """Solve for table and exponent; ``choose`` takes the penalty of least cross-validation error."""
        root = np.sqrt(self._trust)[:, None]
        by_exponent = self._learns_exponent * self.pressed * self._log_force
        rows = np.column_stack([self._basis * self.amplitude[:, None], by_exponent]) * root
        readings = (self._p - self._offset) * root[:, 0]
        normal, best, n_kept = rows.T @ rows, math.inf, self.kept.sum()
        information = float(np.trace(normal[:-1, :-1]))
        for weight in WEIGHTS if choose else [self._weight]:
            prior = weight * information / np.trace(_ROUGHNESS) * _ROUGHNESS
            # points that no reading reaches have zeros in both: a small number keeps it definite
            inverse = np.linalg.inv(normal + prior + 1e-12 * information * np.eye(POINTS))
            found = inverse @ (rows.T @ readings)
            left = readings - rows @ found
            score = float(left @ left) / max(n_kept - float((inverse * normal).sum()), 1.0) ** 2
            if score < best:
                best, self._weight, law, self._covariance = score, weight, found, inverse
        self._rows, self.table = rows, law[:-1]
        self.exponent = float(np.clip(self.exponent + np.clip(law[-1], -0.2, 0.2), 0.2, 2.0))

    def find_variances(self, left: Floats) -> None:
        """Split residuals (Pa) into noise, which does not depend on force and distance, and the misfit.

        What the unknowns have taken up of them is added.
        """
        kept, amplitude, tactel = self.kept, self.amplitude, self.tactels.owner
        by_law = (self._rows @ self._covariance * self._rows).sum(axis=1)
        taken_up = by_law + self.tactels.taken_up + self.presses.taken_up
        at = np.minimum(self.d / REACH * BINS, BINS - 1.0).astype(np.intp)
        sd = np.sqrt(self.variance + self._unmatched)
        square = np.minimum(left**2, (CLIP * sd) ** 2) / (1.0 - np.minimum(taken_up, MOST_LEVERAGE))

        def by_bin(x: Floats) -> Floats:
            return np.bincount(at, kept * x, BINS).astype(np.float64)

        # the readings farthest from presses show the noise
        quiet = kept & (self.d >= np.quantile(self.d[kept], FAR))
        # where all that is quiet reads the same step, the residuals are none, and readings still uncertain
        self.noise = np.sqrt(np.maximum(square[quiet].mean(), self._floor**2))
        excess = square - self.noise[tactel] ** 2
        # moments weighted by amplitude^2 / variance^2: strong presses determine most of what grows with force
        weight = (amplitude / self.variance) ** 2
        scale = by_bin(weight * amplitude**2)
        usable = (by_bin(np.ones(len(at))) >= MIN_READINGS) & (scale > 0.0)
        if usable.any():
            found = np.sqrt(np.maximum(by_bin(weight * excess)[usable] / scale[usable], 0.0))
            self._misfit_profile = np.interp(np.arange(BINS), np.flatnonzero(usable), found)
        self.variance = self.noise[tactel] ** 2 + (amplitude * self._misfit_at(self.d)) ** 2
        pressed = np.abs(self.pressed)
        loud = kept & (pressed > LOUD * pressed[kept].max())
        self.misfit = math.sqrt(max(float(np.mean(excess[loud] / pressed[loud] ** 2)), 0.0))

    def _misfit_at(self, d: Floats) -> Floats:
        """Return the misfit at distances d (m), per unit of effective force; (...,) Pa."""
        return np.interp(d / REACH * BINS - 0.5, np.arange(BINS), self._misfit_profile)

    def find_outliers(self) -> None:
        """Leave out the presses whose residuals deviate far more than those of the others."""
        z2 = self.residuals**2 / (self.variance + self._unmatched)
        score = np.sqrt(self.presses.sum @ z2 / np.maximum(self.presses.count, 1.0))
        seen = score[self.presses.known]
        worst = np.quantile(seen, 1.0 - OUTLIER_SHARE)
        self.outlier = score > max(OUTLIER * np.median(seen), OUTLIER, worst)

    def find_maps(self, arm: Arm) -> Floats | None:
        """Return maps (n_tactels, n, n) of what the law leaves, per unit of effective force, if any.

        The misfit is then what they leave at presses that they were not made from.
        """
        yaw = np.array([placed.yaw for placed in arm.patches])[arm.tactel_patch[self.tactels.owner]]
        scale, kept = np.sqrt(self.variance), self.kept
        maps, left = residual_maps(
            (self.away * np.exp(-1j * yaw))[kept],
            self.tactels.owner[kept],
            (self.residuals / scale)[kept],
            (scale / self.amplitude)[kept],
            arm.n_tactels,
        )
        if maps is not None:
            beside, least = self.residuals, LEFT_BY_MAP * self._misfit_profile
            beside[kept] = left * scale[kept]
            self.find_variances(beside)
            self._misfit_profile = np.maximum(self._misfit_profile, least)
        return maps

    def law(self, to_newtons: float, *, has_map: bool) -> Radial:
        """Return the law, cut where it has faded, not within a map, on all points again."""
        if not self.table[0] > 0.0:
            raise ValueError("the readings do not rise towards the presses: are the places right?")
        last = int(np.flatnonzero(np.abs(self.table) > TRIM * self.table[0]).max())
        at = np.linspace(0.0, min(max(STEP * (last + 2), MAP_REACH * has_map), REACH), POINTS)
        basis = _matrix(_PROFILES, at)
        k = basis @ self.table
        unknown = (basis @ self._covariance[:-1, :-1] * basis).sum(axis=1)
        gain, width, _ = self.tactels.variance
        unknown += gain * k**2 + width * (at / STEP * (_matrix(_SLOPES, at) @ self.table)) ** 2
        return Radial(
            float(at[1]),
            k * (at < at[-1]) * to_newtons,
            exponent=self.exponent,
            misfit=self.misfit,
            misfit_profile=np.sqrt(self._misfit_at(at) ** 2 + unknown) * to_newtons,
            typical_force=math.exp(self.middle),
        )


def _matrix(of: PPoly, d: Floats) -> Floats:
    """Return the matrix (n, POINTS - 1) from a table to profile or slope at distances.

    Profiles are those of ``Radial.profile``, slopes theirs times the step of the table. The last point of the
    table is 0, as is all beyond it.
    """
    matrix = of(d / STEP)
    matrix[np.isnan(matrix[:, 0])] = 0.0
    return matrix[:, :-1]


def _unit_profiles() -> CubicHermiteSpline:
    """Return the profiles of tables that are 1 at one point and 0 elsewhere, over d / step.

    Cubic Hermite polynomials; slopes are central differences, 0 at d = 0, one-sided at the end.
    """
    slopes: Any = np.gradient(np.eye(POINTS), axis=0)
    slopes[0] = 0.0
    return CubicHermiteSpline(np.arange(POINTS), np.eye(POINTS), slopes, extrapolate=False)


def _roughness() -> Floats:
    """Return the penalty on third differences of a table that is even about 0 and ends at zero.

    Its last row and column, of zeros, are those of the exponent.
    """
    even = np.concatenate([[2, 1], np.arange(POINTS)])  # ..., table[-1], table[0], ...
    differences = np.diff(np.eye(POINTS)[even], n=3, axis=0)
    differences[:, -1] = 0.0
    return np.asarray(differences.T @ differences)


_PROFILES = _unit_profiles()
_SLOPES = _PROFILES.derivative()
_ROUGHNESS = _roughness()
