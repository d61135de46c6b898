"""The area that each tactel stands for when the pressure of an arm is integrated.

::

    F = sum_j A_j p_j,    A_j such that  sum_j A_j k(|x - x_j|) = 1  for presses x all over the boards

k is the law of the board, in 1/m^2. Least squares of what is missing from 1, near the areas that are nearer
to a tactel than to any other; then the areas of each board are scaled so that its mean is 1: wide presses are
integrated without bias. Half of the seam to a board beside it is part of a board.

Assumption: the pressures of several presses add up, and what a law predicts for 5 N holds for all forces: a
cone or an exponent deviates from that by a few per cent.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from skinbus.estimate.kernels.layout import SEAM
from skinbus.model import Arm, Surface

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Sparse = sparse.csr_matrix

REACH: Final = 35e-3
"""Distance within which a press is felt and tactels are summed, m. Under a layer of 6 mm, 4 % of its force
lie beyond 20 mm, and outer tactels of usual boards side by side are 21 mm apart."""
PLACES: Final = 4e-3
"""Distance of the presses that areas are learned from, m, at least two for each tactel."""
RIDGE: Final = 0.03
"""Weight of the nearest areas beside the presses: those of a regular board stay regular."""
USUAL_N: Final = 5.0
"""Force of these presses, N."""
GAPS: Final = 0.25e-3 * np.arange(1, 21)
"""Widths of seams that are looked for, m; the narrowest found counts."""
NARROW: Final = 0.6
"""Width of a press beside the law: that of a finger of 12 mm becomes that of a tip, 0.7, under a cover
that is thinner by a sixth; with 0.7 more bars over gaps are further off than their deviation."""
ROUNDS: Final = 8
"""Of the scaling: boards share presses at their seams only."""
ITERATIONS: Final = 60
"""Of conjugate gradients: the ridge bounds the condition."""


class Presses(NamedTuple):
    """Presses of 1 N, all over the boards and half their seams, (n_presses,) each."""

    s: Floats
    """m"""
    a: Floats
    board: Ints
    weight: Floats
    """m^2, the area that each stands for."""
    law: Sparse
    """(n_presses, n_tactels) Pa."""
    narrow: Sparse
    """The same under a tip."""


class Areas(NamedTuple):
    """What integrates the pressures of an arm."""

    area: Floats
    """(n_tactels,) m^2, by which a pressure is multiplied."""
    cell: Floats
    """(n_tactels,) m^2, what is nearer to a tactel than to any other of its board and those beside it."""
    rim: npt.NDArray[np.bool_]
    """(n_tactels,) nearest to an edge of its board with no other beside it."""
    near: Sparse
    """(n_tactels, n_tactels) tactels of a link that one press reaches."""
    presses: Presses
    """Those that the areas are learned from."""


def learn_areas(arm: Arm) -> Areas:
    """Return the areas of an arm."""
    n, p = arm.n_tactels, arm.n_patches
    cell, rim, places, near = np.zeros(n), np.zeros(n, np.bool_), [], []
    parts: tuple[list[Sparse], list[Sparse]] = ([], [])
    for patch in range(p):
        around = _around(arm, patch)
        s, a, weight, alone = _places(arm, patch, np.unique(arm.tactel_patch[around]))
        d = _distances(arm, patch, s, a, around)
        nearest = around[d.argmin(axis=1)]
        np.add.at(cell, nearest, weight)
        rim[nearest[alone]] = True
        s, a, weight, d = (column[weight > 0.0] for column in (s, a, weight, d))
        rows, columns = np.nonzero(d <= REACH)
        law, away = arm.patches[patch].patch.law, d[rows, columns]
        for part, width in zip(parts, (1.0, NARROW), strict=True):
            share = law.pressure(away / width, USUAL_N) / (USUAL_N * width * width)
            part.append(Sparse((share, (rows, around[columns])), (len(s), n)))
        places.append(np.stack([s, a, np.full(len(s), patch), weight]))
        own = np.arange(arm.patch_start[patch], arm.patch_start[patch + 1])
        rows, columns = np.nonzero(
            _distances(arm, patch, arm.tactel_s[own], arm.tactel_a[own], around) <= REACH
        )
        near.append(Sparse((np.ones(len(rows)), (rows, around[columns])), (len(own), n)))
    presses, narrow = (sparse.vstack(part).tocsr() for part in parts)
    s, a, board, weight = np.concatenate(places, axis=1)
    board = board.astype(np.int64)
    cell = np.maximum(cell, 1e-12)  # one of two tactels in one place is nearest to nothing
    seen = (presses @ sparse.diags(cell)).tocsr()
    ridge = RIDGE * weight.sum() / n
    back = seen.T.tocsr()

    def normal(x: Floats) -> Floats:
        return np.asarray(back @ (weight * (seen @ x)) + ridge * x)

    factor, _ = cg(
        LinearOperator((n, n), matvec=normal, dtype=np.float64),
        back @ weight + ridge,
        x0=np.ones(n),
        rtol=1e-4,
        maxiter=ITERATIONS,
    )
    total = np.bincount(board, weight, p)
    for _ in range(ROUNDS):
        factor = factor / (np.bincount(board, weight * (seen @ factor), p) / total)[arm.tactel_patch]
    area = factor * cell
    return Areas(
        area=area,
        cell=cell,
        rim=rim,
        near=sparse.vstack(near).tocsr(),
        presses=Presses(s, a, board, weight, presses, narrow),
    )


def _surface(arm: Arm, patch: int) -> Surface:
    return arm.links[int(arm.patch_link[patch])].surface


def _around(arm: Arm, patch: int) -> Ints:
    """Return the tactels of a patch and of those that presses on it or its seams reach."""
    half = np.array([0.5 * math.hypot(*placed.patch.size) for placed in arm.patches])
    d = _surface(arm, patch).distance(arm.patch_s[patch], arm.patch_a[patch], arm.patch_s, arm.patch_a)
    near = (arm.patch_link == arm.patch_link[patch]) & (d <= half + half[patch] + REACH + SEAM)
    return np.flatnonzero(near[arm.tactel_patch])


def _distances(arm: Arm, patch: int, s: Floats, a: Floats, tactels: Ints) -> Floats:
    """Return the distances of places from tactels, (n_places, len(tactels)) m."""
    other_s, other_a = arm.tactel_s[tactels], arm.tactel_a[tactels]
    return np.asarray(_surface(arm, patch).distance(s[:, None], a[:, None], other_s, other_a))


def _places(arm: Arm, patch: int, near: Ints) -> tuple[Floats, Floats, Floats, npt.NDArray[np.bool_]]:
    """Return chart coordinates of places all over a board and half its seams, the area of each (m^2), and
    whether it is on an edge with no board beside it."""
    board = arm.patches[patch].patch
    half = 0.5 * np.array(board.size)
    step = min(PLACES, 0.5 * math.sqrt(4.0 * half[0] * half[1] / board.n_tactels))
    count = np.maximum(np.rint(2.0 * half / step), 1.0).astype(int)
    u, v = (h * ((2.0 * np.arange(n) + 1.0) / n - 1.0) for h, n in zip(half, count, strict=True))
    (w, h), (n_u, n_v) = half, count
    edge_u = np.concatenate([u, u, np.full(n_v, w), np.full(n_v, -w)])
    edge_v = np.concatenate([np.full(n_u, h), np.full(n_u, -h), v, v])
    out_u = np.repeat([0.0, 0.0, 1.0, -1.0], [n_u, n_u, n_v, n_v])
    out_v = np.repeat([1.0, -1.0, 0.0, 0.0], [n_u, n_u, n_v, n_v])
    along = np.repeat([2.0 * w / n_u, 2.0 * h / n_v], [2 * n_u, 2 * n_v])
    edge, out = np.stack([edge_u, edge_v], -1), np.stack([out_u, out_v], -1)
    s, a = arm.on_link(patch, (edge + GAPS[:, None, None] * out).reshape(-1, 2))
    on = _is_on_board(arm, near[near != patch], s, a).reshape(len(GAPS), -1)
    gap = np.where(on.any(axis=0), GAPS[on.argmax(axis=0)], 0.0)
    weight = np.concatenate([np.full(n_u * n_v, 4.0 * w * h / (n_u * n_v)), 0.5 * gap * along])
    grid = np.stack([x.ravel() for x in np.meshgrid(u, v)], -1)
    s, a = arm.on_link(patch, np.concatenate([grid, edge + 0.25 * gap[:, None] * out]))
    return s, a, weight, weight == 0.0


def _is_on_board(arm: Arm, patches: Ints, s: Floats, a: Floats) -> npt.NDArray[np.bool_]:
    """Return whether places are on one of these boards."""
    on = np.zeros(len(s), np.bool_)
    for patch in patches.tolist():
        # to be on the edge is to be on the board
        half = 0.5 * np.array(arm.patches[patch].patch.size) + 1e-9
        on |= (np.abs(arm.on_board(patch, s, a)) <= half).all(axis=-1)
    return on
