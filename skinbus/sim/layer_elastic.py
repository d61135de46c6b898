"""The elastic layer of ``bonded_layer`` bound to an arm, by tables for each indenter and each size of tactel.

Tactels may differ in gain, width, ellipse and a smooth residual (the effect ``response``): at displacement x
from a load F one reads, with the table k of the layer and its peak k(0),

    F gain (|det S| k(|S x|) + k(0) rho(|x|) w(x))

S is symmetric and near 1 (width and ellipse; with its determinant the force that arrives is the same), rho a
profile over distance and w a smooth random function of unit variance, a sum of cosines: ``ResponseColumns``.
Friction is Coulomb's: a push above ``friction`` times the normal force slips and has that much.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from skinbus.arrays import Floats, Ints
from skinbus.sim.bonded_layer import REACH, STEP, quarter_plane, table
from skinbus.sim.indenter import Indenter
from skinbus.sim.layer import Geometry, Loads

CUT = 1e-4
"""Of the peak: about one count of 16 bits under 10 N."""
WIDEST = 1.2
"""Times the reach of the layer: widths of tactels may differ by as much."""


class RoundTables:
    """Tables of a round indenter, by its radius of contact, for tactels of some diameters (m)."""

    def __init__(
        self, indenter: Indenter, diameters: Floats, layer: dict[str, Any], *, tangential: bool = False
    ) -> None:
        self._radii = indenter.radii()
        given: dict[str, Any] = {
            **layer,
            "reach": REACH * layer["thickness"] + 0.5 * (float(diameters.max()) + indenter.length),
            "indenter": Indenter(indenter.shape),
            "tangential": tangential,
        }
        rows = np.array(
            [
                [table(tactel_radius=0.5 * d, indenter_radius=r, **given) for d in diameters.tolist()]
                for r in self._radii.tolist()
            ]
        )
        # beyond the last distance at which any is worth a count, there is no work
        worth = (np.abs(rows) > CUT * np.abs(rows).max(axis=-1, keepdims=True)).any(axis=(0, 1))
        self._rows: Floats = rows[..., : np.flatnonzero(worth)[-1] + 2]
        """(n_radii, n_diameters, n) 1/m^2 at distances of STEP."""
        self.reach = (self._rows.shape[-1] - 1) * STEP

    def at(self, radius: float) -> Floats:
        """Return the tables (n_diameters, n) for a radius of contact, m."""
        if len(self._rows) == 1:
            return np.asarray(self._rows[0])
        grown = radius / self._radii[1]
        row, share = int(grown), grown - int(grown)
        return np.asarray(self._rows[row] + share * (self._rows[row + 1] - self._rows[row]))


def looked_up(tables: Floats, size: Ints, distance: Floats) -> Floats:
    """Return k of ``tables`` (n_sizes, n) for sizes and distances (n,) m, 0 beyond their end."""
    at = distance / STEP
    cell = np.minimum(at.astype(np.intp), tables.shape[1] - 2)
    low, high = tables[size, cell], tables[size, cell + 1]
    return np.where(at < tables.shape[1] - 1, low + (at - cell) * (high - low), 0.0)


class ElasticLaw:
    """The elastic layer bound to an arm."""

    def __init__(
        self, geometry: Geometry, indenters: Sequence[Indenter], *, thickness: float, poisson: float | None
    ) -> None:
        layer: dict[str, Any] = {"thickness": thickness, "poisson": poisson}
        diameters, self._size = np.unique(geometry.diameter, return_inverse=True)
        self._geometry = geometry
        kinds = (False, True) if geometry.friction else (False,)
        self._round = {
            k: [RoundTables(i, diameters, layer, tangential=tangential) for tangential in kinds]
            for k, i in enumerate(indenters)
            if i.shape.is_round
        }
        """Of a push straight down, and of one along the surface where there is friction."""
        self._planes = {
            k: [quarter_plane(i, **layer, tactel_radius=0.5 * d) for d in diameters.tolist()]
            for k, i in enumerate(indenters)
            if not i.shape.is_round
        }

    def add(self, loads: Loads, pressures: Floats) -> None:
        """Add the pressures of all loads, (n_tactels,) Pa."""
        for j in range(loads.n):
            if int(loads.indenter[j]) in self._planes:
                self._add_extended(loads, j, pressures)
            else:
                self._add_round(loads, j, pressures)

    def _add_round(self, loads: Loads, j: int, pressures: Floats) -> None:
        geometry, force, radius = self._geometry, float(loads.force[j]), float(loads.radius[j])
        straight, *pushed = self._round[int(loads.indenter[j])]
        reach = max(tables.reach for tables in (straight, *pushed))
        tactels, x, y = geometry.ways(int(loads.link[j]), loads.s[j], loads.a[j])
        d = np.hypot(x, y)
        near = np.flatnonzero(d < (WIDEST * reach if geometry.response else reach))
        tactels, x, y, d = tactels[near], x[near], y[near], d[near]
        size, tables = self._size[tactels], straight.at(radius)
        if geometry.response:
            k = self._responses(tables, size, tactels, x, y)
        else:
            k = looked_up(tables, size, d)
        pressures[tactels] += force * k
        pull = math.hypot(loads.pull_s[j], loads.pull_a[j])
        if geometry.friction and pull > 0.0:
            stick = force * min(1.0, geometry.friction / pull)  # with less than 1 it slips
            ahead = (loads.pull_s[j] * x + loads.pull_a[j] * y) / np.maximum(d, 1e-12)
            pressures[tactels] += stick * ahead * looked_up(pushed[0].at(radius), size, d)

    def _add_extended(self, loads: Loads, j: int, pressures: Floats) -> None:
        """Add an edge or a palm; where it goes around a closed link, all its turns within reach count."""
        geometry, link, yaw = self._geometry, int(loads.link[j]), loads.yaw[j]
        period = geometry.arm.links[link].surface.period
        for number, (plane, step) in enumerate(self._planes[int(loads.indenter[j])]):
            turns = math.ceil(step * math.hypot(*plane.shape) / period) if period > 0.0 else 0
            for turn in range(-turns, turns + 1):
                tactels, x, y = geometry.ways(link, loads.s[j], loads.a[j], turn)
                u, v = np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x
                k = map_coordinates(plane, np.abs([u, v]) / step, order=1, mode="constant")
                if geometry.response is not None:
                    k *= geometry.response.gain[tactels]
                pressures[tactels] += np.where(self._size[tactels] == number, loads.force[j] * k, 0.0)

    def _responses(self, tables: Floats, size: Ints, tactels: Ints, x: Floats, y: Floats) -> Floats:
        """Return what tactels that differ read per newton, (n,) 1/m^2."""
        response = self._geometry.response
        assert response is not None
        S = response.shape[tactels]
        u, v = (S @ np.stack([x, y], -1)[..., None])[..., 0].T
        k = looked_up(tables, size, np.hypot(u, v)) * np.linalg.det(S)
        if n_waves := response.waves.shape[1]:
            waves = response.waves[tactels]
            phases = waves[..., 0] * x[:, None] + waves[..., 1] * y[:, None] + waves[..., 2]
            rho = np.interp(np.hypot(x, y), *response.residual)
            k += tables[size, 0] * rho * np.cos(phases).sum(axis=1) * np.sqrt(2.0 / n_waves)
        return np.asarray(response.gain[tactels] * k)
