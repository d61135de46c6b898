"""Edges and palms on the elastic layer: its solution convolved with the indenter's pressure.

The pressure at displacement (u, v) from the centre, along and across the indenter, is the Fourier integral

    p(u, v) = F/(4 pi^2)  integral integral  T(xi) D(xi a) B(k_u, k_v) cos(k_u u) cos(k_v v) dk_u dk_v

with xi^2 = k_u^2 + k_v^2, the layer's transfer T, the tactel's disc D (``bonded_layer``) and the indenter's
own transform B, in closed form. It is evaluated once, on a grid over a quarter of the plane, by a fast
Fourier transform: the spectrum falls like exp(-xi z), so that a grid of GRID depths leaves out nothing; a
bilinear look-up errs by 1.5e-3 of the peak at most (``GRID`` says why). A sample costs what a point costs.

Where an indenter goes around a closed link, all its turns within reach count.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.fft import irfft2, next_fast_len
from scipy.ndimage import map_coordinates

from skinbus.sim.bonded_layer import REACH, transfer
from skinbus.sim.indenter import Indenter, disc_average
from skinbus.sim.layer import Floats, Geometry

GRID: Final = 0.04
"""Depths between grid points. Linear interpolation errs by step^2/8 (|p_uu| + |p_vv|); under a line load the
half-space has p_vv = -4 p/z^2 at its peak, which gives 8e-4 of it; what is wider is smoother."""
MAX_POINTS: Final = 2**23
"""Of one grid, 64 MB; a larger one is made coarser."""


@lru_cache(maxsize=8)
def quarter_plane(
    indenter: Indenter, *, thickness: float, poisson: float, depth: float, tactel_radius: float
) -> tuple[Floats, float]:
    """Return pressures per newton, (n_u, n_v) 1/m^2 at multiples of a step, and the step (m)."""
    beyond = REACH * thickness + tactel_radius
    half_u, half_v = 0.5 * indenter.length + beyond, 0.5 * indenter.width + beyond
    step = max(GRID * depth, math.sqrt(half_u * half_v / MAX_POINTS))
    # the period of the transform is twice the plane: images lie beyond the reach of each other
    n_u, n_v = (next_fast_len(2 * math.ceil(half / step), real=True) for half in (half_u, half_v))
    n_v += n_v % 2
    k_u = math.tau * np.abs(np.fft.fftfreq(n_u, step))[:, None]
    k_v = math.tau * np.asarray(np.fft.rfftfreq(n_v, step), np.float64)
    xi = np.hypot(k_u, k_v)
    spectrum: Floats = transfer(xi, thickness=thickness, poisson=poisson, depth=depth)
    spectrum *= disc_average(xi * tactel_radius)
    spectrum *= indenter.transform(k_u, k_v)
    plane = irfft2(spectrum, s=(n_u, n_v), overwrite_x=True) / (step * step)
    quarter = np.ascontiguousarray(plane[: n_u // 2, : n_v // 2])
    quarter.setflags(write=False)
    return quarter, step


class ExtendedTables:
    """Edges and palms on a layer, for tactels of some diameters (m)."""

    def __init__(self, indenters: Sequence[Indenter], diameters: Floats, layer: dict[str, float]) -> None:
        self._planes = {
            number: [quarter_plane(i, **layer, tactel_radius=0.5 * float(diameter)) for diameter in diameters]
            for number, i in enumerate(indenters)
            if not i.shape.is_round
        }

    def add(
        self,
        indenter: int,
        geometry: Geometry,
        place: tuple[int, float, float],
        yaw: float,
        force: float,
        size: npt.NDArray[np.intp],
        pressures: Floats,
    ) -> None:
        """Add the pressures of a load at a place (link, s, a) in a direction (rad), (n_tactels,) Pa.

        size: (n_tactels,) number of the diameter of each.
        """
        period = geometry.arm.link_period[place[0]]
        for number, (plane, step) in enumerate(self._planes[indenter]):
            turns = math.ceil(step * math.hypot(*plane.shape) / period) if period > 0.0 else 0
            for turn in range(-turns, turns + 1):
                tactels, x, y = geometry.ways(*place, turn)
                u, v = np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x
                k = map_coordinates(plane, np.abs([u, v]) / step, order=1, mode="constant")
                if geometry.response is not None:
                    k *= geometry.response.gain[tactels]
                pressures[tactels] += np.where(size[tactels] == number, force * k, 0.0)
