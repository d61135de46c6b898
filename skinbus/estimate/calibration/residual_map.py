"""The smooth map of what tactels read beside their own law, from the residuals of presses.

For each tactel the residuals, in units of the misfit at their distance, are a Gaussian process over the place
pressed, with a squared-exponential kernel and white noise. What the map leaves at presses that it was not
made from are the leave-one-out residuals: where they are not clearly smaller there is no map.

Source: C. Rasmussen, C. Williams, Gaussian Processes for Machine Learning (2006), 5.4.2.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats

Places = npt.NDArray[np.complex128]

LENGTH = 0.004
"""m, of the kernel: less no array of presses a few mm apart shows, more is straight over a reach."""
WHITE = 0.2
"""White noise, as a part of the misfit."""
WORTH = 0.9
"""A map is made when it leaves less than this part of the residuals at presses it was not made from."""
FEWEST, MOST = 30, 400
"""Presses of a tactel: with fewer there is no map, and not more make one; the cost grows with the cube."""
MAP_REACH, MAP_STEP = 0.024, 0.002
"""m: half of the length; beyond the reach arrays show 0.2 %."""
FADE = 0.2
"""Part of the reach over which a map fades, so that it ends at zero."""


def residual_maps(
    at: Places, tactel: npt.NDArray[np.intp], z: Floats, scale: Floats, n_tactels: int
) -> tuple[Floats | None, Floats]:
    """Return maps of residuals, (n_tactels, points, points) in the unit of scale, and what they leave of z.

    The maps are None where no smooth map predicts presses that it was not made from.

    Args:
        at: (n,) m, places u + iv from the tactel to the press, in the frame of its board.
        tactel: (n,) of each row.
        z: (n,) residuals in units of scale.
        scale: (n,) what residuals are expected to be at this distance, per unit of amplitude.
        n_tactels: of the skin.
    """
    rng = np.random.default_rng(0)  # which of too many presses are taken; any are as good
    near = np.abs(at) < MAP_REACH
    nodes = np.arange(-MAP_REACH, MAP_REACH + 0.5 * MAP_STEP, MAP_STEP)
    grid = (nodes[:, None] + 1j * nodes).ravel()
    maps, said = np.zeros((n_tactels, len(grid))), np.zeros(len(z))
    for i in range(n_tactels):
        own = rng.permutation(np.flatnonzero(near & (tactel == i)))
        if len(own) < FEWEST:
            continue
        r = own[:MOST]
        inverse = np.linalg.inv(_kernel(at[r], at[r]) + WHITE**2 * np.eye(len(r)))
        weights = inverse @ z[r]
        said[own] = _kernel(at[own], at[r]) @ weights
        # what the others say of each
        said[r] = z[r] - weights / np.diag(inverse)
        order = r[np.argsort(np.abs(at[r]))]
        envelope = np.interp(np.abs(grid), np.abs(at[order]), scale[order])
        maps[i] = (_kernel(grid, at[r]) @ weights) * envelope * _fade(grid)
    left = z - said * _fade(at)
    mapped = said != 0.0
    if not (left[mapped] ** 2).sum() < WORTH**2 * (z[mapped] ** 2).sum():
        return None, z
    return maps.reshape(n_tactels, len(nodes), len(nodes)), left


def _fade(away: Places) -> Floats:
    """Return the part of a map that is left so far (m) from its tactel."""
    return np.clip((MAP_REACH - np.abs(away)) / (FADE * MAP_REACH), 0.0, 1.0)


def _kernel(one: Places, other: Places) -> Floats:
    return (1.0 - WHITE**2) * np.exp(-0.5 * np.abs((one[:, None] - other) / LENGTH) ** 2)
