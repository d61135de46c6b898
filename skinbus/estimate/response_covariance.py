"""What presses leave unknown of a response: the variance of its predictions over the distance.

Table, gains, widths and presses are unknown together: few presses near a tactel leave its gain and the
profile uncertain in common, which neither shows while the other is held.

Source: G. Wahba, Bayesian "confidence intervals" for the cross-validated smoothing spline (1983),
doi:10.1111/j.2517-6161.1983.tb01239.x; arrow matrices by Schur complements.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from skinbus.estimate.press_readings import Readings
from skinbus.estimate.response import BINS, MIN_READINGS, Response
from skinbus.estimate.response_algebra import basis_at

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

PER_TACTEL = 3
"""Gain, logarithm of the width, offset."""


class Slopes(NamedTuple):
    """Derivatives of n readings, one row each, by the unknowns."""

    table: Floats
    """(n, t) by the table."""
    tactels: Floats
    """(n, 3) by gain, width and offset of their tactel."""
    presses: Floats
    """(n, 3) by place and force of their press; (n, 0) where these are exact."""
    weight: Floats
    """(n,) inverse variances of the readings, 0 for those that are left out."""
    tactel: Ints
    press: Ints

    def at(self, rows: Ints) -> Slopes:
        """Return some of the rows."""
        return Slopes._make(column[rows] for column in self)


class Priors(NamedTuple):
    """Precisions before any press."""

    table: Floats
    """(t, t)."""
    tactel: Floats
    """(3,)."""
    press: Floats
    """(3,), or (0,) where presses are exact."""


def unknown_at(state: Response, data: Readings, d: Floats) -> Floats:
    """Return the variance of the law at distances d (m) that presses leave, per unit of effective force.

    For the mean tactel; offsets, which do not grow with the force, are left out. (...,) Pa^2.
    """
    nudge = 1e-3
    basis = basis_at(d, data.step)
    bare = basis @ state.table
    by_width = (basis_at(d / (1.0 + nudge), data.step) @ state.table - bare) / nudge
    tactels, of_tactel = state.by_tactel(widths=True)
    of_table = state.of_table.copy()
    # points that no reading reaches have zeros in both: a small number keeps it definite
    of_table[np.diag_indices_from(of_table)] += 1e-12 * np.trace(of_table)
    exact = data.place_sd == 0.0
    slopes = Slopes(
        state.basis * state.amplitude[:, None],
        tactels,
        np.zeros((len(data.p), 0)) if exact else state.by_press(),
        state.trust(),
        data.tactel,
        data.press,
    )
    priors = Priors(of_table, of_tactel, np.zeros(0) if exact else state.press_sd**-2.0)
    covariance = mean_covariance(slopes, priors)
    rows = np.column_stack([basis, bare, by_width])
    return np.asarray(np.einsum("ri,ij,rj->r", rows, covariance, rows))


def unshown_at(state: Response, data: Readings, d: Floats) -> Floats:
    """Return how far (0 to 1) too few presses are at distances d (m) for their residuals to show a misfit.

    (...,)
    """
    count = np.bincount(
        np.minimum(BINS * state.d / data.reach, BINS - 1.0).astype(np.intp)[state.kept], minlength=BINS
    )
    middle = (np.arange(BINS) + 0.5) * data.reach / BINS
    return np.asarray(np.interp(d, middle, np.clip(3.0 - 2.0 * count / MIN_READINGS, 0.0, 1.0)))


def mean_covariance(slopes: Slopes, priors: Priors) -> Floats:
    """Return the covariance of the table with gain and width of one tactel, the mean over the tactels.

    (t + 2, t + 2).
    """
    used = slopes.at(np.flatnonzero(slopes.weight > 0.0))
    n, parts = slopes.table.shape[1], []
    whole = priors.table.copy()
    for rows in _independent(used):
        own, both, alone = _eliminated(used.at(rows), priors)
        whole += own
        gain = np.linalg.solve(alone, both.T)
        whole -= both @ gain
        parts.append((alone, gain))
    of_table = np.linalg.inv(whole)
    total, count = np.zeros((n + 2, n + 2)), 0
    for alone, gain in parts:
        cross = -of_table @ gain.T
        full = np.linalg.inv(alone) - gain @ cross
        for k in range(0, len(alone), PER_TACTEL):
            at = slice(k, k + 2)
            total[n:, n:] += full[at, at]
            total[:n, n:] += cross[:, at]
            count += 1
    total /= max(count, 1)
    total[:n, :n] = of_table
    total[n:, :n] = total[:n, n:].T
    return total


def _independent(slopes: Slopes) -> list[Ints]:
    """Return the readings of each set of tactels that no press has in common with others."""
    tactel, press = slopes.tactel, slopes.press
    group: npt.NDArray[Any] = tactel
    if slopes.presses.shape[1]:
        n = int(tactel.max(initial=-1)) + 1
        shape = 2 * (n + int(press.max(initial=-1)) + 1,)
        _, label = connected_components(
            coo_array((np.ones(len(press)), (tactel, n + press)), shape), directed=False
        )
        group = label[tactel]
    return _each(group)


def _each(group: npt.NDArray[Any]) -> list[Ints]:
    """Return the rows of each group (n,)."""
    order = np.argsort(group, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1)


def _eliminated(slopes: Slopes, priors: Priors) -> tuple[Floats, Floats, Floats]:
    """Return the normal equations of a set without its presses: table, table by tactels, tactels."""
    table, tactels, presses, weight, tactel, press = slopes
    n, of = table.shape[1], PER_TACTEL
    own, where = np.unique(tactel, return_inverse=True)
    normal = np.zeros((n + of * len(own), n + of * len(own)))
    normal[:n, :n] = table.T @ (weight[:, None] * table)
    for k in range(len(own)):
        rows, at = np.flatnonzero(where == k), slice(n + of * k, n + of * (k + 1))
        weighted = weight[rows, None] * tactels[rows]
        normal[at, at] = tactels[rows].T @ weighted + np.diag(priors.tactel)
        normal[:n, at] = table[rows].T @ weighted
    normal[n:, :n] = normal[:n, n:].T
    if presses.shape[1]:
        for rows in _each(press):
            weighted = weight[rows, None] * presses[rows]
            columns = np.ravel(n + of * where[rows][:, None] + np.arange(of))
            both = np.append(np.arange(n), columns)
            by_tactel = (tactels[rows][:, :, None] * weighted[:, None]).reshape(-1, presses.shape[1])
            by = np.concatenate([table[rows].T @ weighted, by_tactel])
            root = np.linalg.cholesky(presses[rows].T @ weighted + np.diag(priors.press))
            by = np.linalg.solve(root, by.T).T
            normal[np.ix_(both, both)] -= by @ by.T
    return normal[:n, :n], normal[:n, n:], normal[n:, n:]
