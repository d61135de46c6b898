"""The response of a skin as a model with unknowns, and the steps by which calibration improves them in turn.

The model of reading j in press i, at distance d_ij from it::

    p_ij = c_j F_i^e k(d_ij / w_j) + o_j + error,    var(error) = noise_j^2 + (c_j F_i^e m(d_ij))^2

with gain c, width w and offset o of each tactel, drawn to 1, 1 and 0 by what real arrays scatter by, so that
a tactel that presses tell little of keeps the shared profile. k is a table smoothed by a penalty on its third
differences, whose weight generalised cross-validation chooses; m, the misfit, is a profile over the distance:
a law is most wrong where it predicts next to nothing. A press whose readings deviate far more than those of
the others is an outlier and is left out.

Assumption: fewer than a tenth of the presses are outliers.
Source: P. Craven, G. Wahba, Smoothing noisy data with spline functions (1979), doi:10.1007/BF01404567;
P. Huber, Robust Statistics (1981), 7.8, for weights by residuals.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

POINTS = 64
"""Points of the table: what the EDS of a patch holds."""

GAIN_SPREAD, WIDTH_SPREAD, OFFSET_SPREAD = 0.1, 0.04, 0.003
"""Prior standard deviations of a tactel's gain, width and offset (of the peak): those of real arrays."""

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

LEAST_OF_MISFIT = 0.28
"""Part of the misfit that stays under a map of residuals, whatever presses say: between them and beyond
their edge a map predicts less well than at them."""

_WEIGHTS = np.logspace(-5.0, 3.0, 17)
"""Weights of the penalty that are tried, relative to the information of the readings. With smaller ones
a table follows the readings no closer, but between 0 and the nearest press nothing holds it: errors of
rounding, which are not independent, made cross-validation choose them."""


class Readings(NamedTuple):
    """Usable readings, one row each."""

    p: Floats
    press: Ints
    tactel: Ints
    d: Floats
    """m, from the press to the tactel."""
    log_force: Floats
    """Relative to ``middle``."""
    middle: float
    """Logarithm of the geometric mean of the forces."""
    n_presses: int
    step: float
    """m, of the table."""
    floor: Floats
    """(n_tactels,) Pa, the standard deviation that rounding alone gives a reading."""

    @property
    def reach(self) -> float:
        """Distance at which the table ends, m."""
        return self.step * (POINTS - 1)


class Response:
    """The unknowns, and the steps that improve one kind of them with the others held."""

    def __init__(self, readings: Readings, n_tactels: int) -> None:
        self._data = readings
        self.table = np.zeros(POINTS - 1)
        self.gain = np.ones(n_tactels)
        self.width = np.ones(n_tactels)
        self.offset = np.zeros(n_tactels)
        self.exponent = 1.0
        self.noise = np.ones(n_tactels)
        self.misfit = 0.0
        """Of the pressure, where the skin is pressed: one number to report."""
        self.misfit_profile = np.zeros(BINS)
        """At the middles of the bins; per unit of effective force."""
        self.outlier = np.zeros(readings.n_presses, np.bool_)
        self.weight = float(_WEIGHTS[0])
        self.frozen: Floats | None = None
        """Weights of the rows once they are held: (n,)."""
        peak = float(np.abs(readings.p).max())
        self._unmatched = TRUEST * peak
        self.variance = np.full(len(readings.p), (FIRST * peak) ** 2)
        self._penalty = roughness()
        self._kept = np.ones(len(readings.p), np.bool_)
        self._known = np.bincount(readings.tactel, minlength=n_tactels) > 0
        self._refresh_basis()

    def _refresh_basis(self) -> None:
        data = self._data
        x = data.d / self.width[data.tactel] / data.step
        inside = x < POINTS - 1
        self._basis = basis(np.where(inside, x, 0.0))[:, :-1] * inside[:, None]

    @property
    def amplitude(self) -> Floats:
        """Gain of the tactel times effective force, row by row."""
        return np.asarray(self.gain[self._data.tactel] * np.exp(self.exponent * self._data.log_force))

    @property
    def pressed(self) -> Floats:
        """Pressure by the law, row by row (Pa)."""
        return np.asarray(self.amplitude * (self._basis @ self.table))

    @property
    def prediction(self) -> Floats:
        """Pressure that the model gives, row by row (Pa)."""
        return np.asarray(self.pressed + self.offset[self._data.tactel])

    @property
    def residuals(self) -> Floats:
        """Reading minus model, row by row (Pa)."""
        return np.asarray(self._data.p - self.prediction)

    @property
    def kept(self) -> npt.NDArray[np.bool_]:
        """Whether a row belongs to a press that is no outlier."""
        return self._kept

    def _trust(self) -> Floats:
        """Return the weights of the rows: the inverse variance, less for large residuals, 0 for outliers."""
        if self.frozen is not None:
            return self.frozen
        variance = self.variance + self._unmatched**2
        off = np.abs(self.residuals) / np.sqrt(variance)
        return np.asarray(self._kept * np.minimum(1.0, HUBER / np.maximum(off, 1e-300)) / variance)

    def freeze(self) -> None:
        """Hold the weights of the rows from now on: what is left is least squares, which converges."""
        self.frozen = self._trust()

    def fit_profile(self, *, choose: bool) -> None:
        """Solve for the table; ``choose`` takes the penalty's weight of least cross-validation error."""
        root = np.sqrt(self._trust() if self.table.any() else 1.0 / self.variance)
        rows = self._basis * (self.amplitude * root)[:, None]
        readings = (self._data.p - self.offset[self._data.tactel]) * root
        normal, right = rows.T @ rows, rows.T @ readings
        total, n = float(readings @ readings), int(self._kept.sum())
        scale = np.trace(normal) / np.trace(self._penalty)
        best = np.inf
        for weight in _WEIGHTS if choose else [self.weight]:
            matrix = normal + weight * scale * self._penalty
            # points that no reading reaches have zeros in both: a small number keeps it definite
            matrix[np.diag_indices_from(matrix)] += 1e-12 * np.trace(normal) / len(matrix)
            table = np.linalg.solve(matrix, right)
            freedom = float(np.trace(np.linalg.solve(matrix, normal)))
            error = max(total - 2.0 * float(table @ right) + float(table @ normal @ table), 0.0)
            score = error / max(n - freedom, 1.0) ** 2
            if score < best:
                best, self.table, self.weight = score, table, float(weight)

    def fit_tactels(self, *, widths: bool) -> None:
        """Take a Gauss-Newton step in gain, offset and, if wanted, width of every tactel.

        The means of gain and width are 1, that of the offset is 0: what is common belongs to the law.
        """
        data, n = self._data, len(self.gain)
        peak = max(float(np.abs(self.pressed).max()), 1e-300)
        nudge = 1e-3
        x = data.d / (self.width[data.tactel] * (1.0 + nudge)) / data.step
        inside = x < POINTS - 1
        wider = (basis(np.where(inside, x, 0.0))[:, :-1] @ self.table) * inside
        bare = self._basis @ self.table
        force = np.exp(self.exponent * data.log_force)
        gain = self.gain[data.tactel]
        rows = np.stack([force * bare, gain * force * (wider - bare) / nudge, np.ones(len(bare))])
        trust, left = self._trust(), self.residuals
        if not widths:
            rows[1] = 0.0
        prior = np.array([GAIN_SPREAD, WIDTH_SPREAD, OFFSET_SPREAD * peak]) ** -2.0
        normal = np.zeros((n, 3, 3))
        right = -prior * np.stack([self.gain - 1.0, np.log(self.width), self.offset], -1)
        for u in range(3):
            right[:, u] += np.bincount(data.tactel, trust * rows[u] * left, n)
            for v in range(3):
                normal[:, u, v] = np.bincount(data.tactel, trust * rows[u] * rows[v], n)
            normal[:, u, u] += prior[u]
        step = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        # no tactel reads ten times too little and is not dead; a step in width stays where it is linear
        self.gain = np.maximum(self.gain + step[:, 0], 0.1)
        if widths:
            self.width *= np.exp(np.clip(step[:, 1], -0.1, 0.1))
        known = self._known
        self.offset = self.offset + step[:, 2]
        self.offset[known] -= self.offset[known].mean()
        common = float(self.gain[known].mean())
        self.gain[known] /= common
        self.gain[~known] = 1.0
        self.table = self.table * common
        if widths:
            self.width[known] /= np.exp(np.log(self.width[known]).mean())
            self._refresh_basis()

    def fit_exponent(self) -> None:
        """Take one Gauss-Newton step in the exponent, the law's scale following it."""
        pressed, weight = self.pressed, self._trust()
        slope = pressed * self._data.log_force
        # the scale of the table moves along: what is left of the slope is not parallel to the prediction
        share = float(weight @ (slope * pressed)) / float(weight @ pressed**2)
        slope = slope - share * pressed
        step = float(weight @ (slope * self.residuals)) / float(weight @ slope**2)
        self.exponent = float(np.clip(self.exponent + np.clip(step, -0.2, 0.2), 0.2, 2.0))

    def fit_variance(self, residuals: Floats | None = None) -> None:
        """Split the residuals into noise, which does not depend on force and distance, and the misfit.

        ``residuals`` (Pa, row by row) are those that a map leaves, in place of the model's own.
        """
        before = 0.0 if residuals is None else LEAST_OF_MISFIT * self.misfit_profile
        data, kept = self._data, self._kept
        pressed, bin_of = np.abs(self.pressed), self._bins()
        square = self._clipped(self.residuals if residuals is None else residuals)
        quiet = kept & (pressed < 0.02 * pressed[kept].max())
        spread = np.bincount(bin_of[quiet], square[quiet], BINS)
        count = np.bincount(bin_of[quiet], minlength=BINS)
        usable = count >= MIN_READINGS
        if usable.any():
            # the noise is what is left at the distances where least is left; twice that is still scatter
            mean = np.where(usable, spread / np.maximum(count, 1), np.inf)
            quiet &= (mean < 2.0 * mean.min())[bin_of]
        else:
            quiet = kept
        pooled = float(np.mean(square[quiet]))
        # a tactel's own variance, drawn to that of all by the weight of ten readings
        n = np.bincount(data.tactel[quiet], minlength=len(self.noise))
        own = np.bincount(data.tactel[quiet], square[quiet], len(self.noise))
        noise2 = (own + 10.0 * pooled) / (n + 10.0)
        # where all that is quiet reads the same step, the residuals are none, and readings still uncertain
        noise2 = np.maximum(noise2, data.floor**2)
        self.noise = np.sqrt(np.maximum(noise2, (1e-9 * pressed.max()) ** 2))
        self._fit_misfit(square)
        self.misfit_profile = np.maximum(self.misfit_profile, before)
        misfit = self.amplitude * self.misfit_at(data.d)
        self.variance = self.noise[data.tactel] ** 2 + misfit**2
        loud = kept & (pressed > 0.2 * pressed[kept].max())
        if loud.any():
            excess = np.mean((square[loud] - noise2[data.tactel[loud]]) / pressed[loud] ** 2)
            self.misfit = float(np.sqrt(max(excess, 0.0)))

    def _clipped(self, residuals: Floats) -> Floats:
        """Return the squares of residuals, those of outliers among them cut to what normal ones reach."""
        bin_of, relative = self._bins(), np.abs(residuals) / self.amplitude
        most = np.zeros(BINS)
        for b in np.unique(bin_of):
            most[b] = CLIP * 1.4826 * np.median(relative[bin_of == b])
        most_of = np.maximum(most[bin_of] * self.amplitude, CLIP * self._unmatched)
        return np.asarray(np.minimum(np.abs(residuals), most_of) ** 2)

    def _fit_misfit(self, square: Floats) -> None:
        """Write the misfit profile for squares of residuals (Pa^2)."""
        data, kept, bin_of = self._data, self._kept, self._bins()
        amplitude2 = self.amplitude**2
        # moments weighted by amplitude^2 / variance^2: strong presses tell most of what grows with force
        weight = kept * amplitude2 / self.variance**2
        excess = np.bincount(bin_of, weight * (square - self.noise[data.tactel] ** 2), BINS)
        scale = np.bincount(bin_of, weight * amplitude2, BINS)
        count = np.bincount(bin_of[kept], minlength=BINS)
        usable = (count >= MIN_READINGS) & (scale > 0.0)
        middle = np.arange(BINS) + 0.5
        if usable.any():
            found = np.sqrt(np.maximum(excess[usable] / scale[usable], 0.0))
            self.misfit_profile = np.interp(middle, middle[usable], found)

    def misfit_at(self, d: Floats) -> Floats:
        """Return the misfit at distances d (m), per unit of effective force; (...,) Pa."""
        middle = (np.arange(BINS) + 0.5) * self._data.reach / BINS
        return np.asarray(np.interp(d, middle, self.misfit_profile))

    def _bins(self) -> Ints:
        return np.minimum(BINS * self._data.d / self._data.reach, BINS - 1.0).astype(np.intp)

    def find_outliers(self, residuals: Floats | None = None) -> bool:
        """Leave out the presses whose readings deviate far more than those of the others.

        ``residuals`` (Pa, row by row) are others than the model's own. Returns whether outliers have changed.
        """
        data, n = self._data, self._data.n_presses
        bin_of = self._bins()
        relative = np.abs(self.residuals if residuals is None else residuals) / self.amplitude
        # the scale by medians, so that outliers do not hide themselves
        scale = np.zeros(BINS)
        for b in np.unique(bin_of):
            scale[b] = 1.4826 * np.median(relative[bin_of == b])
        noise = np.hypot(self.noise[data.tactel], self._unmatched) / self.amplitude
        z2 = relative**2 / np.maximum(np.maximum(scale[bin_of], noise) ** 2, 1e-300)
        count = np.bincount(data.press, minlength=n)
        score = np.sqrt(np.bincount(data.press, z2, n) / np.maximum(count, 1))
        seen = count > 0
        limit = max(OUTLIER * float(np.median(score[seen])), OUTLIER)
        worst = float(np.quantile(score[seen], 1.0 - OUTLIER_SHARE))
        before = self.outlier
        self.outlier = seen & (score > max(limit, worst))
        if residuals is not None:
            self.outlier |= before
        self._kept = ~self.outlier[data.press]
        return bool((self.outlier != before).any())


def basis(x: Floats) -> Floats:
    """Return the matrix (n, POINTS) from a table to the profile at x (in steps), as in ``Radial.profile``."""
    i = np.minimum(x.astype(np.intp), POINTS - 2)
    t = x - i
    # cubic Hermite polynomials; slopes are central differences, 0 at d = 0, one-sided at the end
    t2, t3 = t * t, t * t * t
    left, right = t3 - 2.0 * t2 + t, t3 - t2
    rows = np.arange(len(x))
    matrix = np.zeros((len(x), POINTS))
    before, after = np.where(i > 0, 0.5 * left, 0.0), np.where(i < POINTS - 2, 0.5 * right, right)
    matrix[rows, i] = 2.0 * t3 - 3.0 * t2 + 1.0 - after
    matrix[rows, i + 1] = 3.0 * t2 - 2.0 * t3 + before
    matrix[rows, i - 1] -= before  # of the first row it is 0, and so it is where i - 1 is the last column
    matrix[rows, np.minimum(i + 2, POINTS - 1)] += after
    return matrix


def roughness() -> Floats:
    """Return the penalty on third differences of a table that is even about 0 and ends at zero."""
    even = np.concatenate([np.arange(2, 0, -1), np.arange(POINTS)])  # table[-2], table[-1], table[0], ...
    third = np.diff(np.eye(POINTS)[even], n=3, axis=0)[:, :-1]
    return np.asarray(third.T @ third)
