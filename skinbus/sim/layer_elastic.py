"""The elastic layer of ``bonded_layer`` bound to an arm, by tables for each indenter and each size of tactel.

Tactels may differ in gain, width, ellipse and a smooth residual (the effect ``response``): at displacement x
from a load F one reads, with the table k of the layer and its peak k(0),

    F gain (|det S| k(|S x|) + k(0) rho(|x|) w(x))

S is symmetric and near 1 (width and ellipse; with its determinant the force that arrives is the same), rho a
profile over distance and w a smooth random function of unit variance, a sum of cosines: ``ResponseColumns``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from skinbus.sim.bonded_layer import REACH, STEP, table
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.layer import Floats, Geometry, Loads

Indices = npt.NDArray[np.intp]

CUT: Final = 1e-4
"""Of the peak: about one count of 16 bits under 10 N."""


class RoundTables:
    """Tables of the round indenters for tactels of some diameters (m), cut where they are nil."""

    def __init__(
        self,
        indenters: Sequence[Indenter],
        diameters: Floats,
        layer: dict[str, float],
        solve: Callable[..., Floats] = table,
    ) -> None:
        widest = max((0.5 * i.length for i in indenters if i.shape.is_round), default=0.0)
        reach = REACH * layer["thickness"] + 0.5 * float(diameters.max()) + widest
        self._rows: dict[int, Floats] = {}
        """(n_radii, n_diameters, n) 1/m^2 at distances of STEP, by the number of the indenter."""
        self._growth: dict[int, float] = {}
        """m, of the contact radius from one row to the next."""
        for number, indenter in enumerate(indenters):
            if indenter.shape.is_round:
                radii = indenter.radii()
                self._growth[number] = float(radii[1]) if len(radii) > 1 else np.inf
                given = {"indenter": Indenter(Shape.SPHERE) if indenter.shape is Shape.SPHERE else Indenter()}
                each = [
                    solve(
                        **layer, **given, tactel_radius=0.5 * float(d), indenter_radius=float(r), reach=reach
                    )
                    for r in radii
                    for d in diameters
                ]
                self._rows[number] = np.reshape(each, (len(radii), len(diameters), -1))
        # beyond the last distance at which any table is worth a count, there is no work
        worth = [np.abs(k) > CUT * np.abs(k).max(axis=-1, keepdims=True) for k in self._rows.values()]
        n = max((int(np.flatnonzero(w.any(axis=(0, 1)))[-1]) for w in worth if w.any()), default=0) + 2
        self._rows = {number: rows[..., :n] for number, rows in self._rows.items()}
        self.reach = (n - 1) * STEP

    def of(self, indenter: int, radius: float) -> Any:
        """Return the tables (n_diameters, n) of an indenter with a radius of contact, m; None: not round."""
        rows = self._rows.get(indenter)
        if rows is None:
            return None
        if len(rows) == 1:
            return rows[0]
        grown = radius / self._growth[indenter]
        row, share = int(grown), grown - int(grown)
        return rows[row] + share * (rows[row + 1] - rows[row])


def looked_up(tables: Floats, size: Indices, distance: Floats) -> Floats:
    """Return k of ``tables`` (n_sizes, n) for sizes and distances (n,) m, 0 beyond their end."""
    at = distance / STEP
    cell = np.minimum(at.astype(np.intp), tables.shape[1] - 2)
    low, high = tables[size, cell], tables[size, cell + 1]
    return np.where(at < tables.shape[1] - 1, low + (at - cell) * (high - low), 0.0)


class ElasticLaw:
    """The elastic layer bound to an arm."""

    def __init__(
        self,
        geometry: Geometry,
        indenters: Sequence[Indenter] | Floats,
        *,
        thickness: float,
        poisson: float,
        depth: float | None = None,
    ) -> None:
        layer = {"thickness": thickness, "poisson": poisson, "depth": thickness if depth is None else depth}
        given = [i if isinstance(i, Indenter) else Indenter(Shape.DISC, 2.0 * float(i)) for i in indenters]
        diameters, size = np.unique(geometry.diameter, return_inverse=True)
        self._geometry, self._size = geometry, size
        self._tables = RoundTables(given, diameters, layer)
        # what a scene does not name is not imported
        self._extended = self._shear = None
        if not all(indenter.shape.is_round for indenter in given):
            from skinbus.sim.layer_extended import ExtendedTables

            self._extended = ExtendedTables(given, diameters, layer)
        if geometry.friction:
            from skinbus.sim.layer_shear import shear_table

            self._shear = RoundTables(given, diameters, layer, shear_table)
        self._reach = max(self._tables.reach, self._shear.reach if self._shear else 0.0)
        if geometry.response:
            self._reach *= 1.2  # widths may differ by as much

    def add(self, loads: Loads, pressures: Floats) -> None:
        """Add the pressures of all loads, (n_tactels,) Pa."""
        geometry = self._geometry
        for j in range(loads.n):
            indenter, force = int(loads.indenter[j]), float(loads.force[j])
            place = int(loads.link[j]), float(loads.s[j]), float(loads.a[j])
            tables = self._tables.of(indenter, float(loads.radius[j]))
            if tables is None:
                assert self._extended is not None
                self._extended.add(
                    indenter, geometry, place, float(loads.yaw[j]), force, self._size, pressures
                )
                continue
            tactels, x, y = geometry.ways(*place)
            d = np.hypot(x, y)
            near = np.flatnonzero(d < self._reach)
            tactels, x, y, d = tactels[near], x[near], y[near], d[near]
            size = self._size[tactels]
            k = (
                self._responses(tables, size, tactels, x, y)
                if geometry.response
                else looked_up(tables, size, d)
            )
            pressures[tactels] += force * k
            pull = float(np.hypot(loads.pull_s[j], loads.pull_a[j]))
            if self._shear is not None and pull > 0.0 and geometry.friction:
                pushed = self._shear.of(indenter, float(loads.radius[j]))
                stick = force * min(1.0, geometry.friction / pull)  # with less than 1 it slips
                ahead = (loads.pull_s[j] * x + loads.pull_a[j] * y) / np.maximum(d, 1e-12)
                pressures[tactels] += stick * ahead * looked_up(pushed, size, d)

    def _responses(self, tables: Floats, size: Indices, tactels: Indices, x: Floats, y: Floats) -> Floats:
        """Return what tactels that differ read per newton, (n,) 1/m^2."""
        response = self._geometry.response
        assert response is not None
        S = response.shape[tactels]
        u, v = S[:, 0, 0] * x + S[:, 0, 1] * y, S[:, 1, 0] * x + S[:, 1, 1] * y
        k = looked_up(tables, size, np.hypot(u, v)) * (S[:, 0, 0] * S[:, 1, 1] - S[:, 0, 1] * S[:, 1, 0])
        if n_waves := response.waves.shape[1]:
            waves = response.waves[tactels]
            phases = waves[..., 0] * x[:, None] + waves[..., 1] * y[:, None] + waves[..., 2]
            rho = np.interp(np.hypot(x, y), *response.residual)
            k += tables[size, 0] * rho * np.cos(phases).sum(axis=1) * np.sqrt(2.0 / n_waves)
        return response.gain[tactels] * k
