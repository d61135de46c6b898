"""The smooth map of what tactels read beside their own law, from the residuals of presses.

For each tactel the residuals, in units of the misfit at their distance, are a Gaussian process over the place
pressed, with a squared-exponential kernel and white noise, written by its values at a grid of nodes one
length of the kernel apart. What the map leaves at presses that it was not made from are the leave-one-out
residuals: where they are not smaller there is no map.

Source: C. Rasmussen, C. Williams, Gaussian Processes for Machine Learning (2006), 5.4.2 and 8.3.1, subset of
regressors.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats

Places = npt.NDArray[np.complex128]

LENGTH = 0.004
"""m, of the kernel: less no array of presses a few mm apart shows, more is straight over a reach."""
WHITE = 0.2
"""White noise, as a part of the misfit."""
MAP_REACH, MAP_STEP = 0.024, 0.5 * LENGTH
"""m: half of the side of a map, beyond which arrays show 0.2 %, and the step of its points."""


def residual_maps(
    at: Places,
    tactel: npt.NDArray[np.intp],
    z: Floats,
    scale: Callable[[Floats], Floats],
    n_tactels: int,
) -> tuple[Floats | None, Floats]:
    """Return maps of residuals, (n_tactels, points, points) in the unit of scale, and what they leave of z.

    The maps are None where no smooth map predicts presses that it was not made from.

    Args:
        at: (n,) m, places u + iv from the tactel to the press, in the frame of its board.
        tactel: (n,) of each row.
        z: (n,) residuals in units of scale.
        scale: what residuals are expected to be at distances (m), per unit of amplitude.
        n_tactels: of the skin.
    """
    nodes, points = _grid(LENGTH), _grid(MAP_STEP)
    prior, to_points = WHITE**2 * _kernel(nodes, nodes), _fade(points) * _kernel(points, nodes)
    maps, left, near = np.zeros((n_tactels, len(points))), z.copy(), np.abs(at) < MAP_REACH
    for i in range(n_tactels):
        own = near & (tactel == i)
        rows = _fade(at[own]) * _kernel(at[own], nodes)
        weights = np.linalg.inv(rows.T @ rows + prior) @ rows.T
        maps[i] = to_points @ weights @ z[own]
        # what the others say of each
        left[own] = (z[own] - rows @ weights @ z[own]) / (1.0 - (rows * weights.T).sum(axis=1))
    if not (left[near] ** 2).sum() < (z[near] ** 2).sum():
        return None, z
    side = math.isqrt(len(points))
    return (maps * scale(np.abs(points))).reshape(n_tactels, side, side), left


def _grid(step: float) -> Places:
    """Return the points of a square of half side ``MAP_REACH`` around a tactel, u + iv, row by row."""
    along = step * np.arange(-round(MAP_REACH / step), round(MAP_REACH / step) + 1)
    return np.asarray((along[:, None] + 1j * along).ravel())


def _fade(away: Places) -> Floats:
    """Return the part of a map that is left so far (m) from its tactel, (n, 1): over a length it ends."""
    return np.clip((MAP_REACH - np.abs(away[:, None])) / LENGTH, 0.0, 1.0)


def _kernel(one: Places, other: Places) -> Floats:
    return np.asarray(np.exp(-0.5 * np.abs((one[:, None] - other) / LENGTH) ** 2))
