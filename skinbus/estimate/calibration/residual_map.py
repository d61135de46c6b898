"""The smooth map of what tactels read beside their own law, from the residuals of presses.

For each tactel the residuals, in units of the misfit at their distance, are a Gaussian process over the place
pressed, with a squared-exponential kernel and white noise. Length and noise are those of the largest
leave-one-out likelihood, which also says whether there is anything smooth at all: without a clear gain there
is no map. The leave-one-out residuals are what the map leaves at presses it was not made from.

Source: C. Rasmussen, C. Williams, Gaussian Processes for Machine Learning (2006), 5.4.2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

LENGTHS = (0.0025, 0.004, 0.006, 0.009)
"""m: shorter ones no array of presses a few mm apart shows, longer ones are straight over a reach."""
WHITE = (0.1, 0.2, 0.4, 0.7)
"""White noise that is tried, as a part of the misfit."""
WORTH = 0.9
"""A map is made when it leaves less than this part of the residuals at presses it was not made from."""
MOST = 400
"""Presses of a tactel that a map is made from; the cost grows with the cube."""
CHOSEN_BY, CHOSEN_ON = 150, 8
"""Presses of a tactel, and tactels, that length and noise are chosen by."""
FEWEST = 30
"""Presses of a tactel below which there is no map: some four for each independent place within reach."""
MAP_REACH, MAP_POINTS = 0.024, 25
"""m and points along an axis: 2 mm, no more than the shortest length, beyond where arrays show 0.2 %."""
FADE = 0.2
"""Part of the reach over which a map fades, so that it ends at zero."""


class SmoothResiduals(NamedTuple):
    """Maps (n_tactels, MAP_POINTS, MAP_POINTS), per unit of amplitude, and what they leave, row by row."""

    maps: Floats
    left: Floats
    step: float


def smooth_residuals(
    at: Floats, tactel: npt.NDArray[np.intp], residuals: Floats, scale: Floats, n_tactels: int
) -> SmoothResiduals | None:
    """Return maps of residuals, or None where no smooth map predicts presses it was not made from.

    at:         (n, 2) m, places pressed, from the tactel, in the frame of its board
    tactel:     (n,) of each row
    residuals:  (n,) per unit of amplitude
    scale:      (n,) what residuals are expected to be at this distance, in the same unit
    """
    away = np.hypot(*at.T)
    near = (away < MAP_REACH) & (scale > 0.0)
    rng = np.random.default_rng(0)  # which of too many presses are taken; any are as good
    rows = {i: rng.permutation(np.flatnonzero(near & (tactel == i))) for i in range(n_tactels)}
    rows = {i: np.sort(every[:MOST]) for i, every in rows.items() if len(every) >= FEWEST}
    if not rows:
        return None
    z = residuals / np.where(scale > 0.0, scale, 1.0)
    length, white = _choose(at, z, [rng.permutation(r)[:CHOSEN_BY] for r in list(rows.values())[:CHOSEN_ON]])

    nodes = np.linspace(-MAP_REACH, MAP_REACH, MAP_POINTS)
    grid = np.stack(np.meshgrid(nodes, nodes, indexing="ij"), -1).reshape(-1, 2)
    maps = np.zeros((n_tactels, len(grid)))
    left = residuals.copy()
    before = after = 0.0
    for i, r in rows.items():
        covariance = (1.0 - white**2) * _kernel(at[r], at[r], length) + white**2 * np.eye(len(r))
        inverse = np.linalg.inv(covariance)
        alpha = inverse @ z[r]
        out = alpha / np.diag(inverse)  # what presses leave of themselves, by the others
        rest = np.setdiff1d(np.flatnonzero(near & (tactel == i)), r, assume_unique=True)
        known = np.zeros(len(left))
        known[r] = z[r] - out
        known[rest] = (1.0 - white**2) * _kernel(at[rest], at[r], length) @ alpha
        left -= known * scale * _fade(away)
        before, after = before + float(z[r] @ z[r]), after + float(out @ out)
        order = r[np.argsort(away[r])]
        envelope = np.interp(np.hypot(*grid.T), away[order], scale[order])
        maps[i] = (1.0 - white**2) * (_kernel(grid, at[r], length) @ alpha) * envelope
    if after > WORTH**2 * before:
        return None
    maps *= _fade(np.hypot(*grid.T))
    return SmoothResiduals(maps.reshape(-1, MAP_POINTS, MAP_POINTS), left, float(nodes[1] - nodes[0]))


def _fade(away: Floats) -> Floats:
    """Return the part of a map that is left so far (m) from its tactel."""
    return np.asarray(np.clip((MAP_REACH - away) / (FADE * MAP_REACH), 0.0, 1.0))


def _choose(at: Floats, z: Floats, picked: list[npt.NDArray[np.intp]]) -> tuple[float, float]:
    """Return length and white noise of the largest leave-one-out likelihood, the scale of z profiled out."""
    scores = {}
    for length in LENGTHS:
        spectra = [(z[r], *np.linalg.eigh(_kernel(at[r], at[r], length))) for r in picked]
        for white in WHITE:
            score = 0.0
            for own, values, vectors in spectra:
                rates = 1.0 / (np.maximum(values, 0.0) * (1.0 - white**2) + white**2)
                precision = vectors**2 @ rates
                out = vectors @ (rates * (vectors.T @ own)) / precision
                score += 0.5 * float(np.log(precision).sum() - len(own) * np.log(np.mean(out**2 * precision)))
            scores[length, white] = score
    return max(scores, key=lambda pair: scores[pair])


def _kernel(one: Floats, other: Floats, length: float) -> Floats:
    square = ((one[:, None] - other) ** 2).sum(axis=-1)
    return np.asarray(np.exp(-0.5 * square / (length * length)))
