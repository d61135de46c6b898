"""Linear algebra of a response: the profile as a linear model of its table, steps of many small groups."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

POINTS = 64
"""Points of the table: what the EDS of a patch holds."""
ENOUGH = 2
"""Readings within half a step of a point of the table that determine the profile there: one may be astray."""


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


def uncovered(d: Floats, step: float) -> Ints:
    """Return how many points of the table about each, (POINTS,), no reading at distances d (m) determines.

    0 where readings are near. A press that lies by chance between others does not make their profile known.
    """
    count = np.bincount(np.minimum(np.rint(d / step), POINTS).astype(np.intp), minlength=POINTS)[:POINTS]
    out = np.zeros(POINTS, np.intp)
    near = np.flatnonzero(count >= ENOUGH)
    # beyond the farthest reading the end of the table holds it; about 0 it is even, or readings are clipped
    for begin, end in pairwise(near.tolist()):
        out[begin + 1 : end] = end - begin - 1
    return out


def bridging(d: Floats, step: float) -> Floats:
    """Return the quadratic form, (POINTS - 1, POINTS - 1), of what a table has between knots beside a spline.

    d: (n,) m, distances with readings. Where these leave gaps, knots are as far apart as the gaps: a finer
    shape follows the errors of places and widths. It is 0 where there are no gaps.
    """
    knots = _knots(uncovered(d, step))
    even = np.append(1, np.arange(POINTS))  # table[-1], table[0], ...
    second = np.diff(np.eye(POINTS)[even], n=2, axis=0)[:, :-1]
    bending = second.T @ second
    free = np.setdiff1d(np.arange(POINTS - 1), knots)
    beside = np.zeros((len(free), POINTS - 1))
    beside[np.arange(len(free)), free] = 1.0
    beside[:, knots] = np.linalg.solve(bending[np.ix_(free, free)], bending[np.ix_(free, knots)])
    return np.asarray(beside.T @ beside)


def _knots(bare: Ints) -> Ints:
    """Return points of the table, one at least in each gap and as far apart as gaps beside them."""
    apart = np.ones(POINTS, np.intp)
    for k in np.flatnonzero(bare):
        near = slice(max(k - bare[k], 0), k + bare[k] + 1)
        apart[near] = np.maximum(apart[near], bare[k] + 1)
    knots = [0]
    while True:
        last, wide = knots[-1], int(apart[knots[-1]])
        wide = max(wide, int(apart[last : last + wide + 1].max()))
        if last + wide >= POINTS - 1:
            return np.array(knots)
        knots.append(last + wide)


def smoothed(
    normal: Floats, right: Floats, total: float, n: int, penalties: Sequence[Floats]
) -> tuple[Floats, int]:
    """Return the table of least generalised cross-validation error, and which of the penalties gives it.

    normal, right: its normal equations; total: sum of n squares of weighted readings
    """
    best, at = np.inf, 0
    found: Floats = np.zeros(len(right))
    for k, penalty in enumerate(penalties):
        matrix = normal + penalty
        # points that no reading reaches have zeros in both: a small number keeps it definite
        matrix[np.diag_indices_from(matrix)] += 1e-12 * np.trace(normal) / len(matrix)
        table = np.linalg.solve(matrix, right)
        freedom = float(np.trace(np.linalg.solve(matrix, normal)))
        error = max(total - 2.0 * float(table @ right) + float(table @ normal @ table), 0.0)
        score = error / max(n - freedom, 1.0) ** 2
        if score < best:
            best, at, found = score, k, np.asarray(table)
    return found, at


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
