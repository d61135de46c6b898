"""Calibration: the radial law, gains and noise of a skin from presses at known places and forces.

The model of reading j in press i, at distance d_ij from it::

    p_ij = c_j F_i^e k(d_ij) + error,    var(error) = noise_j^2 + (misfit p_ij)^2

k is the table of ``model.law.Radial`` itself, smoothed by a penalty on its third differences whose weight
generalised cross-validation chooses (Craven and Wahba 1979, doi:10.1007/BF01404567); c, e and the
variances follow in turn until nothing changes. Calibration runs once, at a desk: numpy, not kernels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.layout import limit_of
from skinbus.model import Arm, Radial

Floats = npt.NDArray[np.float64]

POINTS = 64
"""Points of the table: what the EDS of a patch holds."""

REACH = 0.030
"""Distance at which the table ends at first, m: five times the usual thickness of a cover."""

TRIM = 0.002
"""The table is cut where k stays below this part of its peak: a fifth of the usual noise of 1 %."""

GAIN_SPREAD = 0.1
"""Prior standard deviation of a tactel's gain: it decides where a tactel saw little; 3 % is usual."""

MIN_FORCE_RATIO = 1.3
"""The exponent is learned when the largest force is so many times the smallest; else it is 1."""

MIN_READINGS = 20
"""Fewer usable readings than this cannot carry a profile."""

MAX_ITERATIONS = 60
CHOICES = 20
"""Iterations in which the weight of the penalty is chosen and the variances are estimated anew; after that
they stay. Where no radial law is true (a cone, whose reach grows with the force), two weights can call each
other for ever, and readings go to and fro between quiet and pressed."""
TOLERANCE = 1e-7

_WEIGHTS = np.logspace(-9.0, 3.0, 25)
"""Weights of the penalty that are tried, relative to the information of the readings."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """What was learned; ``apply`` puts it into an arm.

    law        the radial law with its misfit; in units of the force of the presses where that is not known
    gain       (n_tactels,) factor from indicated to true pressure, to be used in place of the arm's
    noise      (n_tactels,) standard deviation of a reading, Pa
    residual   root mean square of the weighted residuals; near 1 when the model explains the readings
    n_readings readings that were used
    converged  whether the iteration came to rest; that the law is true is not said by it but by law.misfit
    """

    law: Radial
    gain: Floats
    noise: Floats
    residual: float
    n_readings: int
    converged: bool

    def apply(self, arm: Arm) -> Arm:
        """Return the arm with this law, these gains and this noise."""
        patches = []
        for p, placed in enumerate(arm.patches):
            here = arm.tactels_of(p)
            gain, noise = self.gain[here].copy(), self.noise[here].copy()
            patch = replace(placed.patch, law=self.law, gain=gain, noise=noise)
            patches.append(replace(placed, patch=patch))
        return Arm(arm.name, arm.links, patches, arm.bus)


def learn_radial_law(
    arm: Arm,
    s: npt.ArrayLike,
    a: npt.ArrayLike,
    force: npt.ArrayLike | None,
    pressures: npt.ArrayLike,
    *,
    link: npt.ArrayLike = 0,
    reach: float = REACH,
) -> Calibration:
    """Return what presses at known places tell of a skin.

    s, a:       (n_presses,) m, places of the presses on their link
    force:      (n_presses,) N; None when it is not known, but the same in all of them
    pressures:  (n_presses, n_tactels) Pa, as the arm's present gains give them; NaN for a missing reading.
                Readings at full scale and those of dead tactels are left out.
    link:       (n_presses,) or one number
    reach:      distance beyond which a press is not felt, m; the table is cut shorter where it can be

    Raises:
        ValueError: shapes that do not fit, forces that are not positive, or too few readings to learn from.
    """
    data = _select(arm, s, a, force, pressures, link, reach)
    state = _State(data, arm.n_tactels)
    converged = False
    for iteration in range(MAX_ITERATIONS):
        before = state.prediction
        state.fit_profile(choose=iteration < CHOICES)
        state.fit_gains()
        if data.learns_exponent:
            state.fit_exponent()
        if iteration < CHOICES:
            state.fit_variance()
        change = np.abs(state.prediction - before).max() / max(np.abs(state.prediction).max(), 1e-300)
        if change < TOLERANCE:
            converged = True
            break
    return Calibration(
        law=_trimmed(state),
        gain=np.asarray(arm.tactel_gain) / state.response,
        noise=state.noise,
        residual=float(np.sqrt(np.mean(state.residuals**2 / state.variance))),
        n_readings=len(data.p),
        converged=converged,
    )


class _Data(NamedTuple):
    """Usable readings, one row each."""

    p: Floats
    tactel: npt.NDArray[np.intp]
    basis: Floats
    """(n, POINTS - 1): the profile is ``basis @ table``, its last point held at zero."""
    log_force: Floats
    """Relative to ``middle``."""
    middle: float
    """Logarithm of the geometric mean of the forces."""
    learns_exponent: bool
    step: float


def _select(arm: Arm, s: Any, a: Any, force: Any, pressures: Any, link: Any, reach: float) -> _Data:
    s, a = (np.atleast_1d(np.asarray(x, np.float64)) for x in (s, a))
    table = np.atleast_2d(np.asarray(pressures, np.float64))
    n = len(s)
    if table.shape != (n, arm.n_tactels) or a.shape != (n,):
        wanted = f"({n},) and ({n}, {arm.n_tactels})"
        raise ValueError(f"a and pressures must have shapes {wanted}, got {a.shape} and {table.shape}")
    forces = np.ones(n) if force is None else np.broadcast_to(np.asarray(force, np.float64), n)
    if not (np.isfinite(forces) & (forces > 0.0)).all():
        raise ValueError("forces must be finite and positive")
    links = np.broadcast_to(np.asarray(link), n)
    if not reach > 0.0:
        raise ValueError(f"reach must be positive, got {reach}")

    d = np.full(table.shape, np.inf)
    for number in np.unique(links):
        rows, columns = np.flatnonzero(links == number), np.flatnonzero(arm.tactel_link == number)
        surface = arm.links[number].surface
        d[np.ix_(rows, columns)] = surface.distance(
            s[rows, None], a[rows, None], arm.tactel_s[columns], arm.tactel_a[columns]
        )
    usable = np.isfinite(table) & (d < reach) & arm.tactel_healthy & (table < limit_of(arm))
    if usable.sum() < MIN_READINGS:
        raise ValueError(
            f"only {usable.sum()} usable readings within {1e3 * reach:g} mm of a press; {MIN_READINGS} needed"
        )
    if not (table[usable] > 0.0).any():
        raise ValueError("no reading is above zero: were the places pressed at all?")
    press, tactel = np.nonzero(usable)
    log_force = np.log(forces[press])
    middle = float(log_force.mean())
    step = reach / (POINTS - 1)
    return _Data(
        p=table[press, tactel],
        tactel=tactel,
        basis=_basis(d[press, tactel] / step)[:, :-1],
        log_force=log_force - middle,
        middle=middle,
        learns_exponent=force is not None and bool(forces.max() >= MIN_FORCE_RATIO * forces.min()),
        step=step,
    )


def _basis(x: Floats) -> Floats:
    """Return the matrix (n, POINTS) from a table to the profile at x (in steps), as in ``Radial.profile``."""
    i = np.minimum(x.astype(np.intp), POINTS - 2)
    t = (x - i)[:, None]
    rows = np.arange(len(x))[:, None]
    slopes = np.zeros((POINTS, POINTS))  # central differences; 0 at d = 0, one-sided at the end
    inner = np.arange(1, POINTS - 1)
    slopes[inner, inner + 1], slopes[inner, inner - 1] = 0.5, -0.5
    slopes[-1, -1], slopes[-1, -2] = 1.0, -1.0
    left, right = np.zeros((len(x), POINTS)), np.zeros((len(x), POINTS))
    left[rows, i[:, None]] = 1.0
    right[rows, i[:, None] + 1] = 1.0
    # cubic Hermite polynomials
    t2, t3 = t * t, t * t * t
    smooth = t3 - 2.0 * t2 + t, t3 - t2
    return np.asarray(
        left * (2.0 * t3 - 3.0 * t2 + 1.0)
        + right * (3.0 * t2 - 2.0 * t3)
        + smooth[0] * slopes[i]
        + smooth[1] * slopes[i + 1]
    )


class _State:
    """The unknowns, and the steps that improve one kind of them with the others held."""

    def __init__(self, data: _Data, n_tactels: int) -> None:
        self._data = data
        self.table = np.zeros(POINTS - 1)
        self.response = np.ones(n_tactels)
        self.exponent = 1.0
        self.noise = np.full(n_tactels, 1.0)
        self.misfit = 0.0
        self.weight = float(_WEIGHTS[0])
        self.variance = np.ones(len(data.p))
        self._penalty = _roughness()

    @property
    def amplitude(self) -> Floats:
        """Response of the tactel times effective force, row by row."""
        return np.asarray(self.response[self._data.tactel] * np.exp(self.exponent * self._data.log_force))

    @property
    def prediction(self) -> Floats:
        """Pressure that the model gives, row by row (Pa)."""
        return np.asarray(self.amplitude * (self._data.basis @ self.table))

    @property
    def residuals(self) -> Floats:
        """Reading minus model, row by row (Pa)."""
        return np.asarray(self._data.p - self.prediction)

    def fit_profile(self, *, choose: bool) -> None:
        """Solve for the table; ``choose`` takes the penalty's weight of least cross-validation error."""
        rows = self._data.basis * (self.amplitude / np.sqrt(self.variance))[:, None]
        readings = self._data.p / np.sqrt(self.variance)
        normal, right = rows.T @ rows, rows.T @ readings
        total, n = float(readings @ readings), len(readings)
        scale = np.trace(normal) / np.trace(self._penalty)
        best = np.inf
        for weight in _WEIGHTS if choose else [self.weight]:
            matrix = normal + weight * scale * self._penalty
            # eigenvalues of points that no reading reaches are zero in both: a whisper keeps it definite
            matrix[np.diag_indices_from(matrix)] += 1e-12 * np.trace(normal) / len(matrix)
            table = np.linalg.solve(matrix, right)
            freedom = float(np.trace(np.linalg.solve(matrix, normal)))
            error = max(total - 2.0 * float(table @ right) + float(table @ normal @ table), 0.0)
            score = error / max(n - freedom, 1.0) ** 2
            if score < best:
                best, self.table, self.weight = score, table, float(weight)

    def fit_gains(self) -> None:
        """Solve for the response of every tactel; their mean is 1, what is common belongs to the law."""
        data, n = self._data, len(self.response)
        bare = self.prediction / self.response[data.tactel]
        weight = 1.0 / self.variance
        prior = 1.0 / GAIN_SPREAD**2
        above = np.bincount(data.tactel, weight * bare * data.p, n) + prior
        below = np.bincount(data.tactel, weight * bare * bare, n) + prior
        self.response = np.maximum(
            above / below, 0.1
        )  # no tactel answers ten times too weakly and is not dead
        known = np.bincount(data.tactel, minlength=n) > 0
        common = float(self.response[known].mean())
        self.response[known] /= common
        self.response[~known] = 1.0
        self.table *= common

    def fit_exponent(self) -> None:
        """Take one Gauss-Newton step in the exponent, the law's scale following it."""
        prediction, weight = self.prediction, 1.0 / self.variance
        slope = prediction * self._data.log_force
        # the scale of the table moves along: what is left of the slope is not parallel to the prediction
        share = float(weight @ (slope * prediction)) / float(weight @ prediction**2)
        slope = slope - share * prediction
        step = float(weight @ (slope * self.residuals)) / float(weight @ slope**2)
        self.exponent = float(np.clip(self.exponent + np.clip(step, -0.2, 0.2), 0.2, 2.0))

    def fit_variance(self) -> None:
        """Split the residuals into noise, seen where the skin is quiet, and misfit, where it is pressed."""
        data, square = self._data, self.residuals**2
        prediction = np.abs(self.prediction)
        quiet = prediction < 0.02 * prediction.max()
        pooled = float(np.mean(square[quiet])) if quiet.sum() >= MIN_READINGS else float(np.mean(square))
        # a tactel's own variance, drawn to that of all by the weight of ten readings
        n = np.bincount(data.tactel[quiet], minlength=len(self.noise))
        own = np.bincount(data.tactel[quiet], square[quiet], len(self.noise))
        noise2 = (own + 10.0 * pooled) / (n + 10.0)
        floor = (1e-9 * prediction.max()) ** 2
        self.noise = np.sqrt(np.maximum(noise2, floor))
        loud = prediction > 0.2 * prediction.max()
        if loud.any():
            excess = np.mean((square[loud] - noise2[data.tactel[loud]]) / prediction[loud] ** 2)
            self.misfit = float(np.sqrt(max(excess, 0.0)))
        self.variance = self.noise[data.tactel] ** 2 + (self.misfit * prediction) ** 2


def _roughness() -> Floats:
    """Return the penalty on third differences of a table that is even about 0 and ends at zero."""
    even = np.concatenate([np.arange(2, 0, -1), np.arange(POINTS)])  # table[-2], table[-1], table[0], ...
    third = np.diff(np.eye(POINTS)[even], n=3, axis=0)[:, :-1]
    return np.asarray(third.T @ third)


def _trimmed(state: _State) -> Radial:
    """Return the law in newtons, cut where it has faded and spread over all points again."""
    data = state._data
    table = np.append(state.table, 0.0) * np.exp(-state.exponent * data.middle)
    if not table[0] > 0.0:
        raise ValueError("the readings do not rise towards the presses: are the places right?")
    last = int(np.flatnonzero(np.abs(table) > TRIM * table[0]).max()) + 1
    reach = min(last + 1, POINTS - 1) * data.step
    full = Radial(data.step, table)
    step = reach / (POINTS - 1)
    fine = full.profile(step * np.arange(POINTS))
    fine[-1] = 0.0
    return Radial(step, fine, exponent=state.exponent, misfit=state.misfit)
