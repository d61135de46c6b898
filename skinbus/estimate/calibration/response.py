"""The response of a skin as a model with unknowns, and the steps by which calibration improves them in turn.

The model of reading j in press i, at distance d_ij from it::

    p_ij = c_j F_i^e k(d_ij / w_j) + o_j + error,    var(error) = noise_j^2 + (c_j F_i^e m(d_ij))^2

with gain c, width w and offset o of each tactel, drawn to 1, 1 and 0 by what real arrays scatter by, so that
a tactel that presses tell little of keeps the shared profile. Place and force of a press err alike in all of
its readings: as errors of one reading after the other they would scatter gains and widths, so they are
unknowns, too, drawn to what was said; by how much all these are drawn the presses refine. k is a table
smoothed by a penalty on its third differences, whose weight generalised cross-validation chooses, and held to
a spline where no press has a tactel at such distances; m, the misfit, is a profile over the distance: a law
is most wrong where it predicts next to nothing. Presses that deviate far more than others are left out.

Assumption: fewer than a tenth of the presses are outliers.
Source: P. Craven, G. Wahba, Smoothing noisy data with spline functions (1979), doi:10.1007/BF01404567;
P. Huber, Robust Statistics (1981), 7.8, for weights by residuals; S. Van Huffel, P. Lemmerling, Total Least
Squares and Errors-in-Variables Modeling (2002), for presses.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline
from scipy.sparse import csr_array

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]
Bools = npt.NDArray[np.bool_]

POINTS = 64
"""Points of the table: what the EDS of a patch holds."""
ENOUGH = 2
"""Readings within half a step of a point of the table that determine the profile there: one may be astray."""
GAIN_SPREAD, WIDTH_SPREAD, OFFSET_SPREAD = 0.1, 0.04, 0.003
"""Prior standard deviations of a tactel's gain, width and offset (of the peak): those of real arrays."""
FORCE_SD = 0.02
"""Standard deviation of the force of a press, as a part of it: a load cell, or a weight on a guided tip."""
SAID = 10.0
"""Presses, or tactels, that weigh as much as the standard deviations said when they are refined."""
MOST_OFF = 3.0
"""Standard deviations by which a press is moved at most: an outlier stays one."""
MOST_SD = (1e-3, 1e-3, 0.1)
"""m, m and part of the force: presses that err by more are not moved to where they fit."""
FELT, LOUD = 0.02, 0.2
"""Parts of the largest pressure: below the one a reading shows the noise, above the other the misfit."""
MOST_LEVERAGE = 0.9
"""Part of a reading's variance that the place of its press takes up, at most."""
MIN_READINGS = 20
"""Fewer usable readings than this cannot carry a profile, or a point of the misfit."""
BINS = 16
"""Of the misfit over the distance: 2 mm each where the table begins with 30 mm."""
HUBER = 2.5
"""Standard deviations from which a residual counts less than its square."""
OUTLIER, OUTLIER_SHARE = 4.0, 0.1
"""A press is an outlier when the root mean square of its residuals is so many times the median of all
presses: one displaced by 5 mm has 20 times, the worst of 1600 good ones 3 times. At most this share is."""
CLIP = 4.0
"""Standard deviations to which residuals are cut where variances are estimated: 1 normal one in 16 000 is."""
TRUEST, FIRST = 1e-3, 0.05
"""Parts of the largest reading: the best of laws leaves the one, so that no reading weighs more for being
truer or is an outlier for less than multiples of it; and errors are taken to be the other at first."""
LEAST_OF_MISFIT, FEW_READINGS = 0.10, 400.0
"""Part of the misfit that stays under a map of residuals: between presses it predicts less well than at them.
At so many readings of a tactel its square is twice that. Presses held out leave .8 to 1.2 of what is said."""
WEIGHTS = np.logspace(-5.0, 3.0, 17)
"""Weights of the penalty that are tried, relative to the information of the readings. With smaller ones a
table follows readings no closer, but errors of rounding, which are not independent, made them be chosen."""


class Readings(NamedTuple):
    """Usable readings of presses, one row each."""

    p: Floats
    press: Ints
    tactel: Ints
    d: Floats
    """m, from the press to the tactel."""
    away: Floats
    """(n, 2) m, from the tactel to the press along s and a."""
    log_force: Floats
    """Relative to ``middle``."""
    middle: float
    """Logarithm of the geometric mean of the forces."""
    n_presses: int
    step: float
    """m, of the table."""
    floor: Floats
    """(n_tactels,) Pa, the standard deviation that rounding alone gives a reading."""
    place_sd: float
    """m, of the places of the presses along each direction; 0 where they are exact, and forces, too."""


class Response:
    """The unknowns, and the steps that improve one kind of them with the others held."""

    def __init__(self, readings: Readings, n_tactels: int) -> None:
        self._data = data = readings
        n = len(data.p)
        self.table = np.zeros(POINTS - 1)
        self.tactels = np.zeros((n_tactels, 3))
        """Gain less 1, logarithm of the width, offset (Pa)."""
        self.exponent = 1.0
        self.noise = np.ones(n_tactels)
        self.misfit = 0.0
        """Of the pressure, where the skin is pressed: one number to report."""
        self.misfit_profile = np.zeros(BINS)
        """At the middles of the bins; per unit of effective force."""
        self.outlier = np.zeros(data.n_presses, np.bool_)
        self.press_sd = np.array([data.place_sd, data.place_sd, FORCE_SD])  # of s, a (m), log force
        self.off = np.zeros((data.n_presses, 3))
        """What presses are off by, in these."""
        self._spread = np.ones(3)  # of the tactels, in those of real arrays
        self._tactel_covariance = np.zeros((n_tactels, 3, 3))
        self._of_press = self._of_tactel = np.zeros(n)  # what they take up of a reading's variance; Pa^2
        self._weight, self._prior = float(WEIGHTS[0]), np.zeros((POINTS - 1, POINTS - 1))
        self._frozen: Floats | None = None  # (n,) weights of the rows once they are held
        peak = float(np.abs(data.p).max())
        self._unmatched = TRUEST * peak
        self.variance = np.full(n, (FIRST * peak) ** 2)
        self._bridges = _bridging(data.d, data.step) / self._unmatched**2
        self.kept = np.ones(n, np.bool_)
        """Whether a row belongs to a press that is no outlier."""
        one, at = np.ones(n), np.arange(n)
        # matrices that sum rows by tactel, by press and, below, by bin of the distance
        self._by_tactel: Any = csr_array((one, (data.tactel, at)), (n_tactels, n))
        self._by_press: Any = csr_array((one, (data.press, at)), (data.n_presses, n))
        self._by_bin: Any = None
        self._known: Bools = self._by_tactel @ one > 0.0
        self._refresh()

    @property
    def gain(self) -> Floats:
        """(n_tactels,)."""
        return np.asarray(1.0 + self.tactels[:, 0])

    @property
    def width(self) -> Floats:
        """(n_tactels,)."""
        return np.asarray(np.exp(self.tactels[:, 1]))

    def _refresh(self) -> None:
        """Follow presses and widths: distances, and the matrix from the table to the profile there."""
        data = self._data
        self.away = data.away + self.off[data.press, :2]
        self.d = data.d + np.hypot(*self.away.T) - np.hypot(*data.away.T)
        self._basis = basis_at(self.d / self.width[data.tactel], data.step)
        bin_of = np.minimum(BINS * self.d / (data.step * (POINTS - 1)), BINS - 1.0).astype(np.intp)
        self._by_bin = csr_array(
            (np.ones(len(bin_of)), (bin_of, np.arange(len(bin_of)))), (BINS, len(bin_of))
        )
        self._bin_of = bin_of

    @property
    def amplitude(self) -> Floats:
        """Gain of the tactel times effective force, row by row."""
        data = self._data
        force = np.exp(self.exponent * data.log_force + self.off[data.press, 2])
        return np.asarray(self.gain[data.tactel] * force)

    @property
    def pressed(self) -> Floats:
        """Pressure by the law, row by row (Pa)."""
        return np.asarray(self.amplitude * (self._basis @ self.table))

    @property
    def prediction(self) -> Floats:
        """Pressure that the model gives, row by row (Pa)."""
        return np.asarray(self.pressed + self.tactels[self._data.tactel, 2])

    @property
    def residuals(self) -> Floats:
        """Reading minus model, row by row (Pa)."""
        return np.asarray(self._data.p - self.prediction)

    def trust(self) -> Floats:
        """Return the weights of the rows: the inverse variance, less for large residuals, 0 for outliers."""
        if self._frozen is not None:
            return self._frozen
        if not self.table.any():
            return np.asarray(1.0 / self.variance)
        variance = self.variance + self._unmatched**2
        off = np.abs(self.residuals) / np.sqrt(variance)
        return np.asarray(self.kept * np.minimum(1.0, HUBER / np.maximum(off, 1e-300)) / variance)

    def freeze(self) -> None:
        """Hold the weights of the rows from now on: what is left is least squares, which converges."""
        self._frozen = self.trust()

    def fit_profile(self, *, choose: bool) -> None:
        """Solve for the table; ``choose`` takes the penalty's weight of least cross-validation error."""
        root = np.sqrt(self.trust())
        rows = self._basis * (self.amplitude * root)[:, None]
        readings = (self._data.p - self.tactels[self._data.tactel, 2]) * root
        normal, right, total = rows.T @ rows, rows.T @ readings, float(readings @ readings)
        rough = _roughness()
        scale, best = np.trace(normal) / np.trace(rough), np.inf
        for weight in WEIGHTS if choose else [self._weight]:
            # points that no reading reaches have zeros in both: a small number keeps it definite
            prior = weight * scale * rough + self._bridges
            prior[np.diag_indices_from(prior)] += 1e-12 * np.trace(normal)
            table = np.linalg.solve(normal + prior, right)
            freedom = float(np.trace(np.linalg.solve(normal + prior, normal)))
            error = max(total - 2.0 * float(table @ right) + float(table @ normal @ table), 0.0)
            score = error / max(int(self.kept.sum()) - freedom, 1.0) ** 2
            if score < best:
                best, self.table, self._weight, self._prior = score, table, float(weight), prior
        self._table_covariance = np.linalg.inv(normal + self._prior)

    def fit_tactels(self, *, widths: bool) -> None:
        """Take a Gauss-Newton step in gain, offset and, if wanted, width of every tactel.

        The means of gain and width are 1, that of the offset is 0: what is common belongs to the law.
        """
        data, known, nudge = self._data, self._known, 1e-3
        wider = basis_at(self.d / (self.width[data.tactel] * (1.0 + nudge)), data.step) - self._basis
        by_width = self.amplitude * (wider @ self.table) / nudge
        rows = np.column_stack([self.pressed / self.gain[data.tactel], by_width, np.ones(len(data.p))])
        said = np.array([GAIN_SPREAD, WIDTH_SPREAD, OFFSET_SPREAD * max(np.abs(self.pressed).max(), 1e-300)])
        prior = (self._spread * said) ** -2.0
        if not widths:
            rows[:, 1] = 0.0
        step, covariance = self._step(self._by_tactel, rows, self.tactels, prior)
        if widths:
            self._tactel_covariance = covariance
        self._of_tactel = np.einsum("ri,rij,rj->r", rows, covariance[data.tactel], rows)
        # no tactel reads ten times too little and is not dead; a step in width stays where it is linear
        step[:, 1] = np.clip(step[:, 1], -0.1, 0.1) if widths else 0.0
        self.tactels = self.tactels + step
        self.tactels[:, 0] = np.maximum(self.tactels[:, 0], -0.9)
        if widths and data.place_sd > 0.0:
            square = self.tactels[known] ** 2 + np.einsum("kii->ki", covariance[known])
            self._spread = np.sqrt(((square / said**2).sum(axis=0) + SAID) / (known.sum() + SAID))
        self.tactels[known, 1:] -= self.tactels[known, 1:].mean(axis=0)
        common = float(self.gain[known].mean())
        self.tactels[known, 0] = self.gain[known] / common - 1.0
        self.tactels[~known, 0] = 0.0
        self.table = self.table * common
        self._refresh()

    def fit_presses(self, *, refine: bool) -> None:
        """Take a Gauss-Newton step in place and force of every press; ``refine`` also what they scatter by.

        The mean of the forces stays: it belongs to the law.
        """
        data, nudge = self._data, 1e-5
        if data.place_sd == 0.0:
            return
        further = basis_at((self.d + nudge) / self.width[data.tactel], data.step) - self._basis
        slope = self.amplitude * (further @ self.table) / nudge / np.maximum(self.d, nudge)
        rows = np.column_stack([slope[:, None] * self.away, self.pressed])
        step, covariance = self._step(self._by_press, rows, self.off, self.press_sd**-2.0)
        most = MOST_OFF * self.press_sd
        used = self._by_press @ self.trust() > 0.0
        self.off = np.where(used[:, None], np.clip(self.off + step, -most, most), 0.0)
        self.off[used, 2] -= self.off[used, 2].mean() if used.any() else 0.0
        self._of_press = np.einsum("ri,rij,rj->r", rows, covariance[data.press], rows)
        if refine:
            square = (self.off[used] ** 2 + np.einsum("kii->ki", covariance[used])).sum(axis=0)
            square[:2] = square[:2].mean()
            said = np.array([data.place_sd, data.place_sd, FORCE_SD])
            found = np.sqrt((square + SAID * said**2) / (used.sum() + SAID))
            self.press_sd = np.minimum(found, MOST_SD)
        self._refresh()

    def _step(self, by: Any, rows: Floats, now: Floats, prior: Floats) -> tuple[Floats, Floats]:
        """Return steps (n, k) from unknowns ``now``, drawn to 0, of n groups of readings; covariances."""
        n, k = now.shape
        weighted = self.trust()[:, None] * rows
        normal = (by @ (weighted[:, :, None] * rows[:, None]).reshape(-1, k * k)).reshape(n, k, k)
        covariance = np.linalg.inv(normal + np.diag(prior))
        right = by @ (weighted * self.residuals[:, None]) - prior * now
        return np.einsum("kij,kj->ki", covariance, right), covariance

    def fit_exponent(self) -> None:
        """Take one Gauss-Newton step in the exponent, the law's scale following it."""
        pressed, weight, slope = self.pressed, self.trust(), self.pressed * self._data.log_force
        # the scale of the table moves along: what is left of the slope is not parallel to the prediction
        slope = slope - pressed * float(weight @ (slope * pressed)) / float(weight @ pressed**2)
        step = float(weight @ (slope * self.residuals)) / float(weight @ slope**2)
        self.exponent = float(np.clip(self.exponent + np.clip(step, -0.2, 0.2), 0.2, 2.0))

    def fit_variance(self, residuals: Floats | None = None, *, to_come: bool = False) -> None:
        """Split the residuals into noise, which does not depend on force and distance, and the misfit.

        ``residuals`` (Pa, row by row) are those that a map leaves at presses it was not made from;
        ``to_come`` adds to the model's own what gains, widths and offsets have taken up.
        """
        data, kept, amplitude = self._data, self.kept, self.amplitude
        pressed = np.abs(self.pressed)
        taken_up = self.trust() * (self._of_press + to_come * self._of_tactel)
        off = np.abs(self.residuals if residuals is None else residuals)
        most = np.maximum(CLIP * self._usual(off / amplitude) * amplitude, CLIP * self._unmatched)
        square = np.minimum(off, most) ** 2 / (1.0 - np.minimum(taken_up, MOST_LEVERAGE))
        quiet = kept & (pressed < FELT * pressed[kept].max())
        count = self._by_bin @ quiet.astype(float)
        if (count >= MIN_READINGS).any():
            # the noise is what is left where least is left; twice that is still scatter
            mean = self._by_bin @ (quiet * square) / np.maximum(count, 1.0)
            mean[count < MIN_READINGS] = np.inf
            quiet &= (mean < 2.0 * mean.min())[self._bin_of]
        else:
            quiet = kept
        # a tactel's own variance, drawn to that of all by the weight of ten readings
        own, n = self._by_tactel @ (quiet * square), self._by_tactel @ quiet.astype(float)
        noise2 = (own + 10.0 * float(np.mean(square[quiet]))) / (n + 10.0)
        # where all that is quiet reads the same step, the residuals are none, and readings still uncertain
        self.noise = np.sqrt(np.maximum(noise2, np.maximum(data.floor, 1e-9 * pressed.max()) ** 2))
        excess = square - self.noise[data.tactel] ** 2
        # moments weighted by amplitude^2 / variance^2: strong presses tell most of what grows with force
        weight = kept * (amplitude / self.variance) ** 2
        scale = self._by_bin @ (weight * amplitude**2)
        usable = (self._by_bin @ kept.astype(float) >= MIN_READINGS) & (scale > 0.0)
        least = 0.0 * self.misfit_profile
        if residuals is not None:
            few = FEW_READINGS * self._known.sum() / kept.sum()
            least = LEAST_OF_MISFIT * np.sqrt(1.0 + few) * self.misfit_profile
        if usable.any():
            found = np.sqrt(np.maximum((self._by_bin @ (weight * excess))[usable] / scale[usable], 0.0))
            self.misfit_profile = np.interp(_MIDDLES, _MIDDLES[usable], found)
        self.misfit_profile = np.maximum(self.misfit_profile, least)
        self.variance = self.noise[data.tactel] ** 2 + (amplitude * self.misfit_at(self.d)) ** 2
        loud = kept & (pressed > LOUD * pressed[kept].max())
        if loud.any():
            self.misfit = float(np.sqrt(max(np.mean(excess[loud] / pressed[loud] ** 2), 0.0)))

    def _usual(self, relative: Floats) -> Floats:
        """Return the standard deviation, by medians, of values like each at its distance, row by row."""
        usual = np.zeros(BINS)
        for b in np.unique(self._bin_of):
            usual[b] = 1.4826 * np.median(relative[self._bin_of == b])
        return np.asarray(usual[self._bin_of])

    def misfit_at(self, d: Floats) -> Floats:
        """Return the misfit at distances d (m), per unit of effective force; (...,) Pa."""
        return np.asarray(np.interp(d, _MIDDLES * self._data.step * (POINTS - 1) / BINS, self.misfit_profile))

    def unknown_at(self, d: Floats, *, has_map: bool) -> Floats:
        """Return the variance of the law at distances d (m) that presses leave, per unit of effective force.

        That of the table and of gain and width of the mean tactel, (...,) Pa^2. ``has_map``: the misfit is
        that of presses that a map was not made from: where there are such, it has all of it.
        """
        nudge, known = 1e-3, self._known
        rows = basis_at(d, self._data.step)
        bare = rows @ self.table
        by_width = (basis_at(d / (1.0 + nudge), self._data.step) @ self.table - bare) / nudge
        slopes = np.stack([bare, by_width])
        tactel = self._tactel_covariance[known][:, :2, :2].mean(axis=0)
        unknown = np.einsum("ri,ij,rj->r", rows, self._table_covariance, rows)
        unknown += np.einsum("ir,ij,jr->r", slopes, tactel, slopes)
        if has_map:
            count = self._by_bin @ self.kept.astype(float)
            few = np.clip(3.0 - 2.0 * count / MIN_READINGS, 0.0, 1.0)
            unknown *= np.interp(d, _MIDDLES * self._data.step * (POINTS - 1) / BINS, few)
        return np.asarray(unknown)

    def find_outliers(self, residuals: Floats | None = None) -> bool:
        """Leave out the presses whose readings deviate far more than those of the others.

        ``residuals`` (Pa, row by row) are others than the model's own. Returns whether outliers have changed.
        """
        relative = np.abs(self.residuals if residuals is None else residuals) / self.amplitude
        # the scale by medians, so that outliers do not hide themselves
        noise = np.hypot(self.noise[self._data.tactel], self._unmatched) / self.amplitude
        z2 = (relative / np.maximum(self._usual(relative), noise)) ** 2
        count = self._by_press @ np.ones(len(z2))
        seen = count > 0.0
        score = np.sqrt(self._by_press @ z2 / np.maximum(count, 1.0))
        limit = max(OUTLIER * float(np.median(score[seen])), OUTLIER)
        worst = float(np.quantile(score[seen], 1.0 - OUTLIER_SHARE))
        before = self.outlier
        self.outlier = seen & (score > max(limit, worst))
        if residuals is not None:
            self.outlier |= before
        self.kept = ~self.outlier[self._data.press]
        return bool((self.outlier != before).any())


_MIDDLES = np.arange(BINS) + 0.5


def basis_at(d: Floats, step: float) -> Floats:
    """Return the matrix (n, POINTS - 1) from a table to the profile at distances, as in ``Radial.profile``.

    The last point of the table is 0, as is all beyond it. Cubic Hermite polynomials; slopes are central
    differences, 0 at d = 0, one-sided at the end.
    """
    return np.asarray(np.nan_to_num(_UNIT_PROFILES(d / step))[:, :-1])


def _unit_profiles() -> CubicHermiteSpline:
    """Return the profiles of tables that are 1 at one point and 0 elsewhere, over d / step."""
    points = np.eye(POINTS)
    slopes: Any = np.gradient(points, axis=0)
    slopes[0] = 0.0
    return CubicHermiteSpline(np.arange(POINTS), points, slopes, extrapolate=False)


_UNIT_PROFILES: Final = _unit_profiles()


def _roughness(order: int = 3) -> Floats:
    """Return the penalty on differences of a table that is even about 0 and ends at zero."""
    even = np.concatenate([np.arange(order - 1, 0, -1), np.arange(POINTS)])  # ..., table[-1], table[0], ...
    differences = np.diff(np.eye(POINTS)[even], n=order, axis=0)[:, :-1]
    return np.asarray(differences.T @ differences)


def uncovered(d: Floats, step: float) -> Ints:
    """Return how many points of the table about each, (POINTS,), no reading at distances d (m) determines.

    0 where readings are near. A press that lies by chance between others does not make their profile known.
    """
    count = np.bincount(np.minimum(np.rint(d / step), POINTS).astype(np.intp), minlength=POINTS)[:POINTS]
    out = np.zeros(POINTS, np.intp)
    # beyond the farthest reading the end of the table holds it; about 0 it is even, or readings are clipped
    for begin, end in pairwise(np.flatnonzero(count >= ENOUGH).tolist()):
        out[begin + 1 : end] = end - begin - 1
    return out


def _bridging(d: Floats, step: float) -> Floats:
    """Return the quadratic form, (POINTS - 1, POINTS - 1), of what a table has between knots beside a spline.

    d: (n,) m, distances with readings. Where these leave gaps, knots are as far apart as the gaps: a finer
    shape follows the errors of places and widths. It is 0 where there are no gaps.
    """
    bare, apart = uncovered(d, step), np.ones(POINTS, np.intp)
    knots: Any = [0]
    for k in np.flatnonzero(bare):
        near = slice(max(k - bare[k], 0), k + bare[k] + 1)
        apart[near] = np.maximum(apart[near], bare[k] + 1)
    while True:
        wide = int(apart[knots[-1] : knots[-1] + int(apart[knots[-1]]) + 1].max())
        if knots[-1] + wide >= POINTS - 1:
            break
        knots.append(knots[-1] + wide)
    bending = _roughness(2)
    free = np.setdiff1d(np.arange(POINTS - 1), knots)
    beside = np.eye(POINTS - 1)[free]
    beside[:, knots] = np.linalg.solve(bending[np.ix_(free, free)], bending[np.ix_(free, knots)])
    return np.asarray(beside.T @ beside)
