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

import numpy as np
import numpy.typing as npt

from skinbus.estimate.press_readings import Readings
from skinbus.estimate.response_algebra import (
    POINTS,
    basis_at,
    bridging,
    normal_equations,
    roughness,
    smoothed,
)

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

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
FELT = 0.02
"""Part of the largest pressure of the law from which a reading says something of the place of its press."""
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

_WEIGHTS = np.logspace(-5.0, 3.0, 17)
"""Weights of the penalty that are tried, relative to the information of the readings. With smaller ones a
table follows readings no closer, but errors of rounding, which are not independent, made them be chosen."""


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
        self.spread = np.ones(3)
        """Of gains, widths and offsets, in those of real arrays."""
        self.press_sd = np.array([readings.place_sd, readings.place_sd, FORCE_SD])  # of s, a (m), log force
        self.off = np.zeros((readings.n_presses, 3))
        """What presses are off by, in these."""
        self.d = readings.d
        """m, from where the presses are now."""
        self._leverage = np.zeros(len(readings.p))  # of place and force of its press, for each reading
        self._of_tactel = np.zeros(len(readings.p))
        """Pa^2, variance of the prediction from what is not known of gain, width and offset."""
        self._press_root = np.zeros((readings.n_presses, 3, 3))
        """L of the covariance L L' of what presses are off by."""
        self._uncertain = np.zeros((POINTS - 1, POINTS - 1))
        self.weight = float(_WEIGHTS[0])
        self.of_table = np.zeros((POINTS - 1, POINTS - 1))
        """Precision of the prior that the penalty is."""
        self.frozen: Floats | None = None  # (n,) weights of the rows once they are held
        peak = float(np.abs(readings.p).max())
        self._unmatched = TRUEST * peak
        self.variance = np.full(len(readings.p), (FIRST * peak) ** 2)
        self._penalty = roughness()
        self._bridges = bridging(readings.d, readings.step) / self._unmatched**2
        self.kept = np.ones(len(readings.p), np.bool_)
        """Whether a row belongs to a press that is no outlier."""
        self._known = np.bincount(readings.tactel, minlength=n_tactels) > 0
        self._refresh_basis()

    def _refresh_basis(self) -> None:
        self.basis = basis_at(self.d / self.width[self._data.tactel], self._data.step)

    @property
    def effective_force(self) -> Floats:
        """Force to the power of the exponent, row by row."""
        data = self._data
        return np.asarray(np.exp(self.exponent * data.log_force + self.off[data.press, 2]))

    @property
    def amplitude(self) -> Floats:
        """Gain of the tactel times effective force, row by row."""
        return np.asarray(self.gain[self._data.tactel] * self.effective_force)

    @property
    def pressed(self) -> Floats:
        """Pressure by the law, row by row (Pa)."""
        return np.asarray(self.amplitude * (self.basis @ self.table))

    @property
    def prediction(self) -> Floats:
        """Pressure that the model gives, row by row (Pa)."""
        return np.asarray(self.pressed + self.offset[self._data.tactel])

    @property
    def residuals(self) -> Floats:
        """Reading minus model, row by row (Pa)."""
        return np.asarray(self._data.p - self.prediction)

    def trust(self) -> Floats:
        """Return the weights of the rows: the inverse variance, less for large residuals, 0 for outliers."""
        if self.frozen is not None:
            return self.frozen
        variance = self.variance + self._unmatched**2
        off = np.abs(self.residuals) / np.sqrt(variance)
        return np.asarray(self.kept * np.minimum(1.0, HUBER / np.maximum(off, 1e-300)) / variance)

    def freeze(self) -> None:
        """Hold the weights of the rows from now on: what is left is least squares, which converges."""
        self.frozen = self.trust()

    def fit_profile(self, *, choose: bool) -> None:
        """Solve for the table; ``choose`` takes the penalty's weight of least cross-validation error."""
        root = np.sqrt(self.trust() if self.table.any() else 1.0 / self.variance)
        rows = self.basis * (self.amplitude * root)[:, None]
        readings = (self._data.p - self.offset[self._data.tactel]) * root
        normal, right = rows.T @ rows, rows.T @ readings
        if choose:
            self._uncertain = self._uncertainty(root)
        normal += self._uncertain
        total, n = float(readings @ readings), int(self.kept.sum())
        scale = np.trace(normal) / np.trace(self._penalty)
        weights = _WEIGHTS if choose else [self.weight]
        penalties = [weight * scale * self._penalty + self._bridges for weight in weights]
        self.table, at = smoothed(normal, right, total, n, penalties)
        self.weight, self.of_table = float(weights[at]), penalties[at]

    def _uncertainty(self, root: Floats) -> Floats:
        """Return what the uncertainty of presses adds to the normal equations of the table.

        A steeper table makes more of it: without this term the law is the steeper the more presses it moves.
        """
        data, nudge = self._data, 1e-5
        total = np.zeros((POINTS - 1, POINTS - 1))
        if data.place_sd == 0.0 or not self.table.any():
            return total
        pressed = np.abs(self.pressed)
        (use,) = np.nonzero(pressed > FELT * pressed.max())
        further = basis_at((self.d + nudge)[use] / self.width[data.tactel[use]], data.step)
        own, weight = self.basis[use], (self.amplitude * root)[use, None]
        slope, own = (further - own) * (weight / nudge), own * weight
        along = self.away[use] / np.maximum(self.d[use], nudge)[:, None]
        for u in range(3):
            row = self._press_root[data.press[use], :, u]
            rows = slope * (along * row[:, :2]).sum(axis=1)[:, None] + own * row[:, 2:]
            total += rows.T @ rows
        return total

    def fit_tactels(self, *, widths: bool) -> None:
        """Take a Gauss-Newton step in gain, offset and, if wanted, width of every tactel.

        The means of gain and width are 1, that of the offset is 0: what is common belongs to the law.
        """
        data = self._data
        rows, prior = self.by_tactel(widths=widths)
        trust, left = self.trust(), self.residuals
        now = np.stack([self.gain - 1.0, np.log(self.width), self.offset], -1)
        normal, right = normal_equations(data.tactel, rows, trust, left, now, prior)
        covariance = np.linalg.inv(normal)
        step = np.einsum("kij,kj->ki", covariance, right)
        self._of_tactel = np.einsum("ri,rij,rj->r", rows, covariance[data.tactel], rows)
        # no tactel reads ten times too little and is not dead; a step in width stays where it is linear
        self.gain = np.maximum(self.gain + step[:, 0], 0.1)
        if widths:
            self.width *= np.exp(np.clip(step[:, 1], -0.1, 0.1))
        known = self._known
        if widths and data.place_sd > 0.0:
            said = self._spread_said()
            found = np.stack([self.gain - 1.0, np.log(self.width), self.offset], -1)[known] / said
            own = np.einsum("kii->ki", covariance[known]) / said**2
            self.spread = np.sqrt(((found**2 + own).sum(axis=0) + SAID) / (known.sum() + SAID))
        self.offset = self.offset + step[:, 2]
        self.offset[known] -= self.offset[known].mean()
        common = float(self.gain[known].mean())
        self.gain[known] /= common
        self.gain[~known] = 1.0
        self.table = self.table * common
        if widths:
            self.width[known] /= np.exp(np.log(self.width[known]).mean())
            self._refresh_basis()

    def _spread_said(self) -> Floats:
        """Return the standard deviations of gain, width and offset (Pa) in real arrays."""
        peak = max(float(np.abs(self.pressed).max()), 1e-300)
        return np.array([GAIN_SPREAD, WIDTH_SPREAD, OFFSET_SPREAD * peak])

    def by_tactel(self, *, widths: bool) -> tuple[Floats, Floats]:
        """Return derivatives of the readings by gain, log width and offset; their prior precisions."""
        data, nudge = self._data, 1e-3
        wider = basis_at(self.d / (self.width[data.tactel] * (1.0 + nudge)), data.step) @ self.table
        bare = self.basis @ self.table
        force = self.effective_force
        by_width = self.gain[data.tactel] * force * (wider - bare) / nudge if widths else np.zeros(len(bare))
        rows = np.column_stack([force * bare, by_width, np.ones(len(bare))])
        return rows, (self.spread * self._spread_said()) ** -2.0

    def by_press(self) -> Floats:
        """Return derivatives of the readings by place (per m) and logarithm of the force of their press."""
        data, nudge = self._data, 1e-5
        further = basis_at((self.d + nudge) / self.width[data.tactel], data.step) @ self.table
        pressed = self.pressed
        along = self.away / np.maximum(self.d, nudge)[:, None]
        slope = (self.amplitude * further - pressed) / nudge
        return np.column_stack([slope[:, None] * along, pressed])

    def fit_presses(self, *, refine: bool) -> None:
        """Take a Gauss-Newton step in place and force of every press; ``refine`` also what they scatter by.

        The mean of the forces stays: it belongs to the law.
        """
        data, n = self._data, self._data.n_presses
        if data.place_sd == 0.0:
            return
        rows, trust, left = self.by_press(), self.trust(), self.residuals
        prior = self.press_sd**-2.0
        normal, right = normal_equations(data.press, rows, trust, left, self.off, prior)
        covariance = np.linalg.inv(normal)
        if refine:
            self._press_root = np.linalg.cholesky(covariance)
        most = MOST_OFF * self.press_sd
        self.off = np.clip(self.off + np.einsum("kij,kj->ki", covariance, right), -most, most)
        used = np.bincount(data.press, trust, n) > 0.0
        self.off[~used] = 0.0
        self.off[used, 2] -= self.off[used, 2].mean() if used.any() else 0.0
        self._leverage = trust * np.einsum("ri,rij,rj->r", rows, covariance[data.press], rows)
        self.d = data.d + np.hypot(*self.away.T) - np.hypot(*data.away.T)
        self._refresh_basis()
        if refine:
            square = (self.off[used] ** 2 + np.einsum("kii->ki", covariance[used])).sum(axis=0)
            square[:2] = square[:2].mean()
            said = np.array([data.place_sd, data.place_sd, FORCE_SD])
            found = np.sqrt((square + SAID * said**2) / (used.sum() + SAID))
            self.press_sd = np.minimum(found, MOST_SD)

    @property
    def away(self) -> Floats:
        """(n, 2) m, steps along s and a from tactels to where the presses are now."""
        return np.asarray(self._data.away + self.off[self._data.press, :2])

    def fit_exponent(self) -> None:
        """Take one Gauss-Newton step in the exponent, the law's scale following it."""
        pressed, weight, slope = self.pressed, self.trust(), self.pressed * self._data.log_force
        # the scale of the table moves along: what is left of the slope is not parallel to the prediction
        share = float(weight @ (slope * pressed)) / float(weight @ pressed**2)
        slope = slope - share * pressed
        step = float(weight @ (slope * self.residuals)) / float(weight @ slope**2)
        self.exponent = float(np.clip(self.exponent + np.clip(step, -0.2, 0.2), 0.2, 2.0))

    def fit_variance(self, residuals: Floats | None = None, *, to_come: bool = False) -> None:
        """Split the residuals into noise, which does not depend on force and distance, and the misfit.

        ``residuals`` (Pa, row by row) are those that a map leaves at presses it was not made from;
        ``to_come`` adds to the model's own what gains, widths and offsets have taken up.
        """
        data, kept, taken_up = self._data, self.kept, self._leverage
        floor = LEAST_OF_MISFIT * np.sqrt(1.0 + FEW_READINGS * self._known.sum() / kept.sum())
        before = 0.0 if residuals is None else floor * self.misfit_profile
        pressed, bin_of = np.abs(self.pressed), self._bins()
        taken_up = taken_up + to_come * self.trust() * self._of_tactel
        square = self._clipped(self.residuals if residuals is None else residuals)
        square /= 1.0 - np.minimum(taken_up, MOST_LEVERAGE)
        quiet = kept & (pressed < FELT * pressed[kept].max())
        spread = np.bincount(bin_of[quiet], square[quiet], BINS)
        count = np.bincount(bin_of[quiet], minlength=BINS)
        usable = count >= MIN_READINGS
        if usable.any():
            # the noise is what is left where least is left; twice that is still scatter
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
        self.variance = self.noise[data.tactel] ** 2 + (self.amplitude * self.misfit_at(self.d)) ** 2
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
        data, kept, bin_of = self._data, self.kept, self._bins()
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
        return np.minimum(BINS * self.d / self._data.reach, BINS - 1.0).astype(np.intp)

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
        self.kept = ~self.outlier[data.press]
        return bool((self.outlier != before).any())
