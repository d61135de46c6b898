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
    scale = np.sqrt(np.diag(information))
    nothing = np.full((n, 3, 3), np.nan)
    if not (scale > 0.0).all():
        return nothing
    normed = information / np.outer(scale, scale)
    if np.linalg.cond(normed) > _WORST_CONDITION:
        return nothing
    covariance = np.linalg.inv(normed) / np.outer(scale, scale)
    return np.stack([covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(n)])


def position_bound(covariances: Floats) -> Floats:
    """Return the root mean square distance from the touch at the bound, (n,) m."""
    return np.asarray(np.sqrt(covariances[:, 0, 0] + covariances[:, 1, 1]))
