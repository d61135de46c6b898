"""The Cramer-Rao bound: the smallest covariance that an unbiased estimate of touches can have.

For readings with independent normal noise of standard deviation sigma around p(theta), theta = (s, a, F) of
all touches, the Fisher information is J^T J / sigma^2 with J = dp / dtheta, here by central differences of
the truth itself; the bound is its inverse. A biased estimate (a partition's centroid is one) may fall below.

Source: S. M. Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, section 3.9.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

STEP: Final = 1e-5
"""Of the differences, m and relative force: wide against rounding, narrow against any contact."""
_WORST_CONDITION: Final = 1e10
"""Beyond, the touches are not determined by the readings."""


def bound(predict: Callable[[Floats], Floats], touches: Floats, sigma: float) -> Floats:
    """Return the bounds on the covariance of each touch, (n, 3, 3); NaN where nothing bounds it.

    predict:  pressures (n_tactels,) Pa of touches (n, 3)
    touches:  (n, 3) s and a in m, force in N
    sigma:    standard deviation of a reading, Pa
    """
    flat = np.asarray(touches, np.float64).ravel()
    columns = []
    for i, value in enumerate(flat):
        step = STEP * (value if i % 3 == 2 else 1.0)
        up, down = flat.copy(), flat.copy()
        up[i] += step
        down[i] -= step
        # predict may give its buffer: copy before the next call
        difference = np.array(predict(up.reshape(-1, 3))) - predict(down.reshape(-1, 3))
        columns.append(difference / (2.0 * step * sigma))
    jacobian = np.stack(columns, -1)
    information = jacobian.T @ jacobian
    n = len(flat) // 3
    bounds = np.full((n, 3, 3), np.nan)
    # A touch that is not determined even by itself is taken as known: that can only lower other bounds.
    known = [not _is_determined(information[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]) for k in range(n)]
    sought = np.flatnonzero(~np.repeat(known, 3))
    among = information[np.ix_(sought, sought)]
    if not _is_determined(among):
        return bounds
    scale = np.sqrt(np.diag(among))
    covariance = np.linalg.inv(among / np.outer(scale, scale)) / np.outer(scale, scale)
    for i, k in enumerate(np.flatnonzero(~np.array(known))):
        bounds[k] = covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3]
    return bounds


def position_bound(covariances: Floats) -> Floats:
    """Return the root mean square distance from the touch at the bound, (n,) m."""
    return np.asarray(np.sqrt(covariances[:, 0, 0] + covariances[:, 1, 1]))


def ideal_distances(covariances: Floats, n: int, rng: np.random.Generator) -> Floats:
    """Return how far n ideal estimates of each touch are off, (n_touches, n) m; infinite without a bound."""
    distances = np.full((len(covariances), n), np.inf)
    for k, covariance in enumerate(covariances):
        if np.isfinite(covariance).all():
            errors = rng.standard_normal((n, 2)) @ np.linalg.cholesky(covariance[:2, :2]).T
            distances[k] = np.hypot(*errors.T)
    return distances


def _is_determined(information: Floats) -> bool:
    """Return whether a Fisher information can be inverted: in units in which its diagonal is 1."""
    scale = np.sqrt(np.diag(information))
    if not len(scale) or not (scale > 0.0).all():
        return False
    return bool(np.linalg.cond(information / np.outer(scale, scale)) <= _WORST_CONDITION)
