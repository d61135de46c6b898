"""The elastic layer of ``bonded_layer`` bound to an arm: round loads by tables, others by their own laws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from skinbus.jit import kernel
from skinbus.sim.bonded_layer import STEP
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.layer import (
    Geometry,
    Ints,
    Law,
    Loads,
    Surroundings,
    classes,
    geodesic,
    is_reached,
    link_at,
    radius_at,
    surroundings,
)
from skinbus.sim.round_tables import RoundTables, looked_up, round_tables, row_of

Floats = npt.NDArray[np.float64]


class ElasticLaw:
    """The elastic layer bound to an arm: tables for each indenter and each size of tactel."""

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
        self._near = surroundings(geometry)
        diameters, self._size_of = classes(geometry.diameter)
        self._tables = round_tables(given, diameters, layer)
        self._response = geometry.response
        self._more: list[Law] = []
        # what a scene does not name is not imported
        if not all(indenter.shape.is_round for indenter in given):
            from skinbus.sim.layer_extended import ExtendedLaw

            self._more.append(ExtendedLaw(geometry, given, layer))
        if geometry.friction:
            from skinbus.sim.layer_shear import ShearLaw

            self._more.append(ShearLaw(geometry, given, layer))
        if geometry.response is not None:
            from skinbus.sim.layer_response import add_responses

            self._add_responses = add_responses

    def add(self, loads: Loads, pressures: Floats, touched: npt.NDArray[np.bool_]) -> None:
        """Add the pressures of all loads, (n_tactels,) Pa, and mark the patches written to, (n_patches,)."""
        columns = (loads.n, loads.link, loads.s, loads.a, loads.force, loads.indenter, loads.radius)
        if self._response is None:
            _add(self._near, self._tables, self._size_of, *columns, pressures, touched)
        else:
            self._add_responses(
                self._near, self._tables, self._size_of, self._response, *columns, pressures, touched
            )
        for law in self._more:
            law.add(loads, pressures, touched)


@kernel
def _add(
    near: Surroundings,
    tables: RoundTables,
    size_of: Ints,
    n_loads: int,
    load_link: Ints,
    load_s: Floats,
    load_a: Floats,
    load_force: Floats,
    load_indenter: Ints,
    load_radius: Floats,
    pressures: Floats,
    touched: npt.NDArray[np.bool_],
) -> None:
    last = tables.k.shape[2] - 1
    reach = last * STEP
    for j in range(n_loads):
        k, s, a, force, indenter = load_link[j], load_s[j], load_a[j], load_force[j], load_indenter[j]
        row, share = row_of(tables, indenter, load_radius[j])
        if row < 0:
            continue
        link = link_at(near, k)
        r = radius_at(near, k, s)
        for p in range(len(near.patch_link)):
            if not is_reached(near, p, k, s, a, reach):
                continue
            touched[p] = True
            for i in range(near.patch_start[p], near.patch_start[p + 1]):
                d = geodesic(near.tactel_s[i], near.tactel_a[i], near.tactel_r[i], s, a, r, link)
                x = d / STEP
                if x < last:
                    pressures[i] += force * looked_up(tables, row, share, size_of[i], x)
