"""The paper's cone as a layer law: pressure falls linearly with the distance from the load, to zero.

It is there to reproduce the paper; a scene's default is the elastic layer, so that the law that is fitted is
not the one that was simulated. Tactels are points unless a scene names their disc; then the cone is averaged
over it by a cubature of 36 points (rings of equal area).

Source: the paper, eq. 5-10; see ``model.law.Cone``.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from skinbus.jit import kernel
from skinbus.model.law import Cone
from skinbus.sim.layer import (
    Geometry,
    Ints,
    Loads,
    Surroundings,
    classes,
    geodesic,
    is_reached,
    link_at,
    radius_at,
    surroundings,
)

Floats = npt.NDArray[np.float64]

_RINGS: Final = 6
_SPOKES: Final = 6


class ConeLaw:
    """The cone bound to an arm; ``slope`` (Pa/m) for all patches, or None for what each board's law says."""

    def __init__(self, geometry: Geometry, *, slope: float | None = None) -> None:
        self._near = surroundings(geometry)
        laws = [placed.patch.law for placed in geometry.arm.patches]
        own = [law.slope if isinstance(law, Cone) else Cone().slope for law in laws]
        self._slopes = np.array(own) if slope is None else np.full(len(laws), slope)
        diameters, self._disc_of = classes(geometry.diameter)
        self._discs = np.stack([_disc(0.5 * diameter) for diameter in diameters])
        self._widest = 0.5 * float(diameters.max())

    def add(self, loads: Loads, pressures: Floats, touched: npt.NDArray[np.bool_]) -> None:
        """Add the pressures of all loads, (n_tactels,) Pa, and mark the patches written to, (n_patches,)."""
        _add(
            self._near,
            self._slopes,
            self._discs,
            self._disc_of,
            self._widest,
            loads.n,
            loads.link,
            loads.s,
            loads.a,
            loads.force,
            pressures,
            touched,
        )


def _disc(radius: float) -> Floats:
    """Return points (n, 2) m that average over a disc with equal weights; all at the centre for radius 0."""
    # radii at the middles of rings of equal area, turned against each other
    ring = radius * np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS)
    angle = (
        (np.arange(_SPOKES)[None, :] + np.arange(_RINGS)[:, None] / _RINGS + 0.125) * 2.0 * np.pi / _SPOKES
    )
    return np.stack([(ring[:, None] * np.cos(angle)).ravel(), (ring[:, None] * np.sin(angle)).ravel()], -1)


@kernel
def _add(
    near: Surroundings,
    slopes: Floats,
    discs: Floats,
    disc_of: Ints,
    widest: float,
    n_loads: int,
    load_link: Ints,
    load_s: Floats,
    load_a: Floats,
    load_force: Floats,
    pressures: Floats,
    touched: npt.NDArray[np.bool_],
) -> None:
    n_points = discs.shape[1]
    for j in range(n_loads):
        k, s, a, force = load_link[j], load_s[j], load_a[j], load_force[j]
        link = link_at(near, k)
        r = radius_at(near, k, s)
        for p in range(len(near.patch_link)):
            if near.patch_link[p] != k:
                continue
            height = (3.0 * force * slopes[p] ** 2 / np.pi) ** (1.0 / 3.0)
            base = height / slopes[p]
            if not is_reached(near, p, k, s, a, base + widest):
                continue
            touched[p] = True
            for i in range(near.patch_start[p], near.patch_start[p + 1]):
                d = geodesic(near.tactel_s[i], near.tactel_a[i], near.tactel_r[i], s, a, r, link)
                disc = discs[disc_of[i]]
                if disc[0, 0] == 0.0:
                    pressures[i] += max(0.0, height - slopes[p] * d)
                    continue
                total = 0.0
                for q in range(n_points):
                    away = np.sqrt((d + disc[q, 0]) ** 2 + disc[q, 1] ** 2)
                    total += max(0.0, height - slopes[p] * away)
                pressures[i] += total / n_points
