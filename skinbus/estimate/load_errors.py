"""By how much a sum of pressure times area is off under presses of all kinds, learned from examples.

A sum over tactels sees of a press what falls on them. How much that is depends on what presses and where, and
the readings show part of it. So presses of known force are made on the boards of an arm by their law: tips,
fingers, thumbs, several fingers, bars, edges and palms, each a sum of presses at places that ``load_areas``
has. Of their features x, which the kernel finds in their readings, two polynomials of the second degree are
learned::

    log(F / sum) = b(x) + e,      log E(exp(e) - 1)^2 = v(x)

b by least squares with the weights 1 / exp(v), v by likelihood as of squares of a normal deviate.

Assumption: loads add up; what presses is one of these kinds. Failure: what is like no example has features
outside theirs, and its deviation grows with that.
Source: A. Davidian, R. Carroll, Variance function estimation (1987): regression of squared residuals.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.estimate.kernels.load_sums import TERMS
from skinbus.estimate.load_areas import USUAL_N, Ints, Presses, Sparse
from skinbus.model import Arm

Floats = npt.NDArray[np.float64]

EXAMPLES: Final = 1500
"""Presses for a kind of board: with 6000 no error of a load is smaller by more than its scatter."""
BOARDS: Final = 12
"""Boards of a kind that they are on, at most: boards of one kind differ by what is beside them only."""
TIP, FINGER, THUMB, FINGERS, BAR, PALM = range(6)
SHARES: Final = (0.15, 0.25, 0.15, 0.15, 0.15, 0.15)
"""Prior of what presses."""
FORCES: Final = (1.0, 1.0, 1.0, 1.0, 3.0, 8.0)
"""Middle of the forces, in 5 N; fingers, each."""
FORCE_SPREAD: Final = 0.9
"""Standard deviation of the logarithm of a force: 0.8 to 30 N in 95 % of presses by one finger."""
FELT: Final = 10.0
"""Thresholds on one cell that the middle of the forces has at least: what is not felt is no example."""
THUMB_RADIUS: Final = 9e-3
"""m, at most: a finger of 12 mm everywhere within it presses like a disc of 25 mm."""
NEXT: Final = (13e-3, 35e-3)
"""Distances of fingers in a row of two to four, m."""
OFF: Final = 5e-3
"""From a place within which a press is there, m: one that is further is beyond a rim, and not on the arm."""
BARS: Final = ((12e-3, 60e-3), (4e-3, 12e-3))
PALMS: Final = ((25e-3, 110e-3), (12e-3, 65e-3))
"""Lengths and widths, m."""
AROUND: Final = 0.08
"""m along either axis from the centre of a board, in which presses on it are made of others."""
GAINS: Final = 0.03
"""Standard deviation of gains."""
RIDGE: Final = 1.0
"""Examples that say that a term is zero."""
ROUNDS: Final = 3
"""Of b and v in turn; nothing changes after two."""
STEPS: Final = 8
"""Of Fisher's method for v."""
LEAST: Final = 0.005
"""Share below which errors cannot be distinguished: the tail of a law."""
PART: Final = 100
"""Examples of which sums are made at a time."""
OUTLIER: Final = 25.0
"""Square of an error, in its variance, as which larger ones count: one in a gap must not hide all others."""


def examples_of(arm: Arm, presses: Presses, boards: Ints, noise: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield for each of these boards readings (n, n_tactels) Pa of presses on it and their forces (n,) N.

    ``noise`` (n_tactels,) Pa.
    """
    rng = np.random.default_rng(0)  # any presses are as good
    chosen = boards[np.linspace(0.0, len(boards) - 1.0, min(BOARDS, len(boards))).astype(np.int64)]
    grain = rng.standard_normal(2 * arm.n_tactels + EXAMPLES)
    for board in chosen.tolist():
        period = float(arm.link_period[arm.patch_link[board]])
        s, a = presses.s - arm.patch_s[board], _around(presses.a - arm.patch_a[board], period)
        near = np.flatnonzero(
            (arm.patch_link[presses.board] == arm.patch_link[board])
            & (np.maximum(np.abs(s), np.abs(a)) < AROUND)
        )
        own = np.flatnonzero(presses.board[near] == board)
        weight = presses.weight[near]
        n = -(-EXAMPLES // len(chosen))
        centre = rng.choice(own, n, p=weight[own] / weight[own].sum())
        kind = rng.choice(len(SHARES), n, p=SHARES)
        x = s[near] - s[near][centre, None]
        y = _around(a[near] - a[near][centre, None], period)
        carried = _carried(rng, kind, x, y, weight)
        here = slice(arm.patch_start[board], arm.patch_start[board + 1])
        area = 4.0 * np.prod(0.5 * np.array(arm.patches[board].patch.size)) / (here.stop - here.start)
        middle = max(USUAL_N, FELT * area * float(arm.tactel_threshold[here].mean()))
        force = middle * np.array(FORCES)[kind] * np.exp(FORCE_SPREAD * rng.standard_normal(n))
        force *= np.where(kind == FINGERS, np.count_nonzero(carried, axis=1), 1)
        carried *= (force / carried.sum(axis=1))[:, None]
        narrow = (kind == TIP) | (kind == BAR)
        felt = np.empty((n, arm.n_tactels))
        for rows, table in ((narrow, presses.narrow), (~narrow, presses.law)):
            felt[rows] = (Sparse(carried[rows]) @ table[near]).toarray()
        at = rng.integers(0, len(grain) - 2 * arm.n_tactels, n)[:, None] + np.arange(arm.n_tactels)
        felt *= 1.0 + GAINS * grain[at]
        yield felt + noise * grain[at + arm.n_tactels], force


def _carried(rng: np.random.Generator, kind: Ints, x: Floats, y: Floats, weight: Floats) -> Floats:
    """Return what each place carries of each press, (n, m), from distances (n, m) m of its centre."""
    n = len(kind)
    carried = np.zeros(x.shape)
    carried[np.arange(n), (x * x + y * y).argmin(axis=1)] = weight.mean()
    way, radius = rng.uniform(0.0, np.pi, n), rng.uniform(0.0, THUMB_RADIUS, n)
    thumb = kind == THUMB
    carried[thumb] += np.where(np.hypot(x[thumb], y[thumb]) <= radius[thumb, None], weight, 0.0)
    for which, sizes in ((BAR, BARS), (PALM, PALMS)):
        rows = np.flatnonzero(kind == which)
        along, across = _turned(way[rows], x[rows], y[rows])
        half = [0.5 * rng.uniform(least, most, len(rows))[:, None] for least, most in sizes]
        carried[rows] += np.where((np.abs(along) <= half[0]) & (np.abs(across) <= half[1]), weight, 0.0)
    hand = np.flatnonzero(kind == FINGERS)
    along, across = _turned(way[hand], x[hand], y[hand])
    gap, fingers = rng.uniform(*NEXT, len(hand))[:, None], rng.integers(2, 5, len(hand))
    for other in range(1, 4):
        off = np.hypot(along - other * gap, across)
        nearest = off.argmin(axis=1)
        here = (other < fingers) & (off.min(axis=1) < OFF)
        carried[hand[here], nearest[here]] = weight.mean() * rng.uniform(0.5, 2.0, np.count_nonzero(here))
    return carried


def _turned(way: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return distances along a way (n,) rad and across it."""
    cos, sin = np.cos(way)[:, None], np.sin(way)[:, None]
    return cos * x + sin * y, cos * y - sin * x


def _around(a: Floats, period: float) -> Floats:
    """Return distances around a link, within half a turn, m."""
    return a - period * np.rint(a / period) if period > 0.0 else a


def learn_errors(features: Floats, error: Floats) -> tuple[Floats, Floats]:
    """Return scale (4, n_features) and polynomials (2, TERMS) of examples (n, n_features), (n,).

    ``error`` is log(F / sum).
    """
    scale = np.stack([features.mean(0), features.std(0) + 1e-3, features.min(0), features.max(0)])
    x = (features - scale[0]) / scale[1]
    rows, columns = np.tril_indices(x.shape[1])
    terms = np.concatenate([np.ones((len(x), 1)), x, x[:, rows] * x[:, columns]], axis=1)
    weight, even = np.ones(len(x)), _inverse(terms, np.ones(len(x)))
    b, v = np.zeros(TERMS), np.zeros(TERMS)
    for _ in range(ROUNDS):
        b = _inverse(terms, weight) @ _sum(terms, weight * error)
        square = np.expm1(error - _at(terms, b)) ** 2 + LEAST * LEAST
        v = even @ _sum(terms, np.log(square))
        for _ in range(STEPS):
            v += even @ _sum(terms, np.minimum(square / np.exp(_at(terms, v)), OUTLIER) - 1.0)
        weight = np.exp(-_at(terms, v))
        weight /= weight.mean()
    return scale, np.stack([b, v])


def _inverse(terms: Floats, weight: Floats) -> Floats:
    """Return the inverse of the normal matrix of terms (n, m), with the ridge, (m, m)."""
    normal = RIDGE * np.eye(terms.shape[1])
    # in parts that are too small for more than one thread, which costs more than it saves
    for first in range(0, len(terms), PART):
        part = terms[first : first + PART]
        normal += (part.T * weight[first : first + PART]) @ part
    return np.asarray(np.linalg.inv(normal))


def _at(terms: Floats, b: Floats) -> Floats:
    """Return a polynomial at all terms (n, m), (n,)."""
    return np.asarray(np.einsum("nm,m->n", terms, b))


def _sum(terms: Floats, value: Floats) -> Floats:
    """Return the sums of terms (n, m) times values (n,), (m,)."""
    return np.asarray(np.einsum("nm,n->m", terms, value))
