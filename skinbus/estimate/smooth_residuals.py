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
CHOSEN_BY = 150
"""Presses of a tactel that length and noise are chosen by; the cost grows with the cube."""
MOST = 400
"""Presses of a tactel that a map is made from; the cost grows with the cube."""
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
    x: Floats, y: Floats, tactel: npt.NDArray[np.intp], residuals: Floats, scale: Floats, n_tactels: int
) -> SmoothResiduals | None:
    """Return maps of residuals, or None where no smooth map predicts presses it was not made from.

    x, y:       (n,) m, places pressed, from the tactel, in the frame of its board
    tactel:     (n,) of each row
    residuals:  (n,) per unit of amplitude
    scale:      (n,) what residuals are expected to be at this distance, in the same unit
    """
    near = (np.hypot(x, y) < MAP_REACH) & (scale > 0.0)
    every = [np.flatnonzero(near & (tactel == i)) for i in range(n_tactels)]
    rng = np.random.default_rng(0)  # which of too many presses are taken; any are as good
    rows = [r if len(r) <= MOST else np.sort(rng.choice(r, MOST, replace=False)) for r in every]
    usable = [i for i in range(n_tactels) if len(rows[i]) >= FEWEST]
    if not usable:
        return None
    relative = residuals / np.where(scale > 0.0, scale, 1.0)
    length, white = _choose(x, y, relative, [rows[i] for i in usable], rng)

    nodes = np.linspace(-MAP_REACH, MAP_REACH, MAP_POINTS)
    grid = np.stack(np.meshgrid(nodes, nodes, indexing="ij"), -1).reshape(-1, 2)
    away = np.hypot(*grid.T)
    maps = np.zeros((n_tactels, len(grid)))
    left = residuals.copy()
    before = after = 0.0
    for i in usable:
        r = rows[i]
        z = residuals[r] / scale[r]
        cov = _kernel(x[r], y[r], x[r], y[r], length)
        inverse = np.linalg.inv(cov * (1 - white**2) + white**2 * np.eye(len(r)))
        alpha = inverse @ z
        out = alpha / np.diag(inverse)
        rest = np.setdiff1d(every[i], r, assume_unique=True)
        known = _kernel(x[rest], y[rest], x[r], y[r], length) @ alpha
        left[rest] -= (1 - white**2) * known * scale[rest] * _fade(x[rest], y[rest])
        left[r] -= (z - out) * scale[r] * _fade(x[r], y[r])
        before, after = before + float(z @ z), after + float(out @ out)
        cross = _kernel(grid[:, 0], grid[:, 1], x[r], y[r], length)
        order = np.argsort(np.hypot(x[r], y[r]))
        envelope = np.interp(away, np.hypot(x[r], y[r])[order], scale[r][order])
        maps[i] = (1 - white**2) * (cross @ alpha) * envelope * _fade(*grid.T)
    if after > WORTH**2 * before:
        return None
    return SmoothResiduals(maps.reshape(-1, MAP_POINTS, MAP_POINTS), left, float(nodes[1] - nodes[0]))


def _fade(x: Floats, y: Floats) -> Floats:
    """Return the part of a map that is left at places (m) from its tactel."""
    return np.asarray(np.clip((MAP_REACH - np.hypot(x, y)) / (FADE * MAP_REACH), 0.0, 1.0))


def _choose(
    x: Floats, y: Floats, z: Floats, rows: list[npt.NDArray[np.intp]], rng: np.random.Generator
) -> tuple[float, float]:
    """Return length and white noise of the largest leave-one-out likelihood."""
    picked = [r if len(r) <= CHOSEN_BY else rng.choice(r, CHOSEN_BY, replace=False) for r in rows[:8]]
    best, chosen = -np.inf, (LENGTHS[0], WHITE[-1])
    for length in LENGTHS:
        spectra = [np.linalg.eigh(_kernel(x[r], y[r], x[r], y[r], length)) for r in picked]
        for white in WHITE:
            score = 0.0
            for r, (values, vectors) in zip(picked, spectra, strict=True):
                rates = 1.0 / (np.maximum(values, 0.0) * (1 - white**2) + white**2)
                precision = (vectors**2) @ rates
                out = vectors @ (rates * (vectors.T @ z[r])) / precision
                # the scale of z is free: it is profiled out
                score += 0.5 * float(np.log(precision).sum())
                score -= 0.5 * len(r) * float(np.log(np.mean(out**2 * precision)))
            if score > best:
                best, chosen = score, (length, white)
    return chosen


def _kernel(x1: Floats, y1: Floats, x2: Floats, y2: Floats, length: float) -> Floats:
    square = np.subtract.outer(x1, x2) ** 2 + np.subtract.outer(y1, y2) ** 2
    return np.asarray(np.exp(-0.5 * square / (length * length)))
