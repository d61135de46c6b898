"""What presses leave unknown of a response: the variance of its predictions over the distance.

Table, gains, widths and presses are unknown together: few presses near a tactel leave its gain and the
profile uncertain in common, which neither shows while the other is held.

Source: G. Wahba, Bayesian "confidence intervals" for the cross-validated smoothing spline (1983),
doi:10.1111/j.2517-6161.1983.tb01239.x; arrow matrices by Schur complements.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from skinbus.estimate.press_readings import Readings
from skinbus.estimate.response import Response
from skinbus.estimate.response_algebra import basis_at

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

PER_TACTEL = 3
"""Gain, logarithm of the width, offset."""


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
    covariance = mean_covariance(
        state.basis * state.amplitude[:, None],
        tactels,
        np.zeros((len(data.p), 0)) if exact else state.by_press(),
        state.trust(),
        data.tactel,
        data.press,
        (of_table, of_tactel, np.zeros(0) if exact else state.press_sd**-2.0),
    )
    rows = np.column_stack([basis, bare, by_width])
    return np.asarray(np.einsum("ri,ij,rj->r", rows, covariance, rows))


def mean_covariance(
    table: Floats,
    tactels: Floats,
    presses: Floats,
    weight: Floats,
    tactel: Ints,
    press: Ints,
    prior: tuple[Floats, Floats, Floats],
) -> Floats:
    """Return the covariance of the table with gain and width of one tactel, the mean over the tactels.

    table:    (n, t) derivatives of the readings by the table
    tactels:  (n, 3) by gain, width and offset of their tactel
    presses:  (n, 3) by place and force of their press; (n, 0) where these are exact
    weight:   (n,) inverse variances of the readings, 0 for those that are left out
    tactel:   (n,) tactel of each reading
    press:    (n,) press of each reading
    prior:    precisions (t, t) of the table, (3,) of a tactel, (3,) of a press

    Returns (t + 2, t + 2).
    """
    used = np.flatnonzero(weight > 0.0)
    n, parts = table.shape[1], []
    whole = prior[0].copy()
    for rows in _independent(tactel[used], press[used], presses.shape[1] > 0):
        here = used[rows]
        part = _eliminated(
            table[here], tactels[here], presses[here], weight[here], tactel[here], press[here], prior
        )
        own, both, alone = part
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


def _independent(tactel: Ints, press: Ints, by_press: bool) -> list[Ints]:
    """Return the readings of each set of tactels that no press has in common with others."""
    group: npt.NDArray[Any] = tactel
    if by_press:
        n = int(tactel.max(initial=-1)) + 1
        shape = 2 * (n + int(press.max(initial=-1)) + 1,)
        _, label = connected_components(
            coo_array((np.ones(len(press)), (tactel, n + press)), shape), directed=False
        )
        group = label[tactel]
    order = np.argsort(group, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1)


def _eliminated(
    table: Floats,
    tactels: Floats,
    presses: Floats,
    weight: Floats,
    tactel: Ints,
    press: Ints,
    prior: tuple[Floats, Floats, Floats],
) -> tuple[Floats, Floats, Floats]:
    """Return the normal equations of a set without its presses: table, table by tactels, tactels."""
    n, of = table.shape[1], PER_TACTEL
    own, where = np.unique(tactel, return_inverse=True)
    normal = np.zeros((n + of * len(own), n + of * len(own)))
    normal[:n, :n] = table.T @ (weight[:, None] * table)
    for k in range(len(own)):
        rows, at = np.flatnonzero(where == k), slice(n + of * k, n + of * (k + 1))
        weighted = weight[rows, None] * tactels[rows]
        normal[at, at] = tactels[rows].T @ weighted + np.diag(prior[1])
        normal[:n, at] = table[rows].T @ weighted
    normal[n:, :n] = normal[:n, n:].T
    if presses.shape[1]:
        order = np.argsort(press, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(press[order])) + 1):
            weighted = weight[rows, None] * presses[rows]
            columns = np.ravel(n + of * where[rows][:, None] + np.arange(of))
            both = np.append(np.arange(n), columns)
            by_tactel = (tactels[rows][:, :, None] * weighted[:, None]).reshape(-1, presses.shape[1])
            by = np.concatenate([table[rows].T @ weighted, by_tactel])
            root = np.linalg.cholesky(presses[rows].T @ weighted + np.diag(prior[2]))
            by = np.linalg.solve(root, by.T).T
            normal[np.ix_(both, both)] -= by @ by.T
    return normal[:n, :n], normal[:n, n:], normal[n:, n:]
