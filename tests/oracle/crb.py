"""The Cramer-Rao bound by numerical differentiation of the truth: shares no code with the estimator."""

import numpy as np

from tests.oracle.fields import pressures_of

STEP = 1e-7
"""m and relative force: errors of the central difference stay below 1e-6 of the derivative."""


def bound(arm, touches, field, sigma):
    """Covariances (n, 3, 3) at the bound of touches (n, 3): s, a, force; None where one is not determined."""
    flat = np.ravel(touches)

    def predict(parameters):
        return pressures_of(arm, parameters.reshape(-1, 3), field)

    columns = []
    for i, value in enumerate(flat):
        step = STEP * (value if i % 3 == 2 else 1.0)
        up, down = flat.copy(), flat.copy()
        up[i] += step
        down[i] -= step
        columns.append((predict(up) - predict(down)) / (2.0 * step))
    jacobian = np.stack(columns, -1) / sigma
    information = jacobian.T @ jacobian
    scale = np.sqrt(np.diag(information))
    if (scale == 0.0).any():
        return None
    normed = information / np.outer(scale, scale)
    if np.linalg.cond(normed) > 1e8:
        return None
    covariance = np.linalg.inv(normed) / np.outer(scale, scale)
    n = len(touches)
    return np.stack([covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(n)])


def ideal_median(covariances, rng, draws=200):
    """Median of |error| / CRB of ideal estimators at the bound: of the position, and of the force."""
    ratios = []
    for covariance in covariances:
        place = covariance[:2, :2]
        error = rng.multivariate_normal(np.zeros(2), place, draws, method="cholesky")
        ratios.append(np.hypot(*error.T) / np.sqrt(np.trace(place)))
    return float(np.median(ratios)), 0.67448975  # of |z| of a normal z
