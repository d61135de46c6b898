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

from skinbus.jit import kernel
from skinbus.sim.bonded_layer import REACH, transfer
from skinbus.sim.indenter import Indenter, disc_average
from skinbus.sim.layer import (
    Geometry,
    Loads,
    Surroundings,
    classes,
    displacement,
    is_reached,
    radius_at,
    surroundings,
)

Floats = npt.NDArray[np.float64]

GRID: Final = 0.04
"""Depths between grid points. Linear interpolation errs by step^2/8 (|p_uu| + |p_vv|); under a line load the
half-space has p_vv = -4 p/z^2 at its peak, which gives 8e-4 of it; what is wider is smoother."""
MAX_POINTS: Final = 2**23
"""Of one grid, 64 MB; a larger one is made coarser."""


def quarter_plane(
    indenter: Indenter, *, thickness: float, poisson: float, depth: float, tactel_radius: float
) -> tuple[Floats, float]:
    """Return pressures per newton, (n_u, n_v) 1/m^2 at multiples of a step, and the step (m)."""
    return _quarter_plane(indenter, thickness, poisson, depth, tactel_radius)


@lru_cache(maxsize=8)
def _quarter_plane(
    indenter: Indenter, thickness: float, poisson: float, depth: float, tactel_radius: float
) -> tuple[Floats, float]:
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


class ExtendedLaw:
    """Edges and palms bound to an arm."""

    def __init__(self, geometry: Geometry, indenters: Sequence[Indenter], layer: dict[str, float]) -> None:
        self._near = surroundings(geometry)
        diameters, self._size_of = classes(geometry.diameter)
        self._gain = np.ones(geometry.arm.n_tactels) if geometry.response is None else geometry.response.gain
        self._tables = {
            number: [quarter_plane(i, **layer, tactel_radius=0.5 * float(diameter)) for diameter in diameters]
            for number, i in enumerate(indenters)
            if not i.shape.is_round
        }

    def add(self, loads: Loads, pressures: Floats, touched: npt.NDArray[np.bool_]) -> None:
        """Add the pressures of all edges and palms, (n_tactels,) Pa, and mark the patches written to."""
        for j in range(loads.n):
            for size, (quarter, step) in enumerate(self._tables.get(int(loads.indenter[j]), ())):
                _add(
                    self._near,
                    quarter,
                    step,
                    self._size_of == size,
                    self._gain,
                    int(loads.link[j]),
                    (float(loads.s[j]), float(loads.a[j]), float(loads.yaw[j]), float(loads.force[j])),
                    pressures,
                    touched,
                )


@kernel
def _add(
    near: Surroundings,
    quarter: Floats,
    step: float,
    is_size: npt.NDArray[np.bool_],
    gain: Floats,
    k: int,
    load: tuple[float, float, float, float],
    pressures: Floats,
    touched: npt.NDArray[np.bool_],
) -> None:
    s, a, yaw, force = load
    cos, sin = np.cos(yaw), np.sin(yaw)
    end_u, end_v = quarter.shape[0] - 1, quarter.shape[1] - 1
    reach = step * np.hypot(float(end_u), float(end_v))
    period = near.link_period[k]
    link = (near.link_radius[k], near.link_taper[k], 0.0)  # turns are counted here
    r = radius_at(near, k, s)
    turns = int(np.ceil(reach / period)) if period > 0.0 else 0
    for p in range(len(near.patch_link)):
        if not is_reached(near, p, k, s, a, reach):
            continue
        touched[p] = True
        for i in range(near.patch_start[p], near.patch_start[p + 1]):
            if not is_size[i]:
                continue
            value = 0.0
            for turn in range(-turns, turns + 1):
                x, y = displacement(
                    near.tactel_s[i], near.tactel_a[i] + turn * period, near.tactel_r[i], s, a, r, link
                )
                u, v = abs(cos * x + sin * y) / step, abs(-sin * x + cos * y) / step
                if u < end_u and v < end_v:
                    m, n = int(u), int(v)
                    f, g = u - m, v - n
                    value += (1.0 - f) * ((1.0 - g) * quarter[m, n] + g * quarter[m, n + 1])
                    value += f * ((1.0 - g) * quarter[m + 1, n] + g * quarter[m + 1, n + 1])
            pressures[i] += force * gain[i] * value
