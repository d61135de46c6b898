"""Linear algebra of a response: the profile as a linear model of its table, steps of many small groups."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

POINTS = 64
"""Points of the table: what the EDS of a patch holds."""


def basis_at(d: Floats, step: float) -> Floats:
    """Return the matrix (n, POINTS - 1) from a table to the profile at distances, as in ``Radial.profile``.

    The last point of the table is 0, as is all beyond it.
    """
    x = d / step
    inside = x < POINTS - 1
    return np.asarray(_basis(np.where(inside, x, 0.0))[:, :-1] * inside[:, None])


def _basis(x: Floats) -> Floats:
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


def normal_equations(
    group: Ints, rows: Floats, weight: Floats, left: Floats, now: Floats, prior: Floats
) -> tuple[Floats, Floats]:
    """Return matrices (n, k, k) and right sides (n, k) of a step from unknowns ``now`` (n, k), drawn to 0.

    rows: (n_rows, k) derivatives of readings whose residuals are ``left``, each of one of n groups
    """
    n, k = now.shape
    normal, right = np.zeros((n, k, k)), -prior * now
    for u in range(k):
        right[:, u] += np.bincount(group, weight * rows[:, u] * left, n)
        for v in range(k):
            normal[:, u, v] = np.bincount(group, weight * rows[:, u] * rows[:, v], n)
        normal[:, u, u] += prior[u]
    return normal, right
