"""The elastic layer under tactels that differ: in gain, width, ellipse and a smooth residual.

A tactel at displacement x from a load F reads, with the table k of the layer and its peak k(0),

    F gain (|det S| k(|S x|) + k(0) rho(|x|) w(x))

S is symmetric and near 1 (width and ellipse; with its determinant the force that arrives is the same), rho a
profile over distance and w a smooth random function of unit variance, a sum of cosines: ``ResponseColumns``.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from skinbus.jit import setup
from skinbus.sim.bonded_layer import STEP
from skinbus.sim.layer import (
    Ints,
    ResponseColumns,
    Surroundings,
    displacement,
    is_reached,
    link_at,
    radius_at,
)
from skinbus.sim.round_tables import RoundTables, looked_up, row_of

Floats = npt.NDArray[np.float64]


@setup  # np.interp allocates
def add_responses(
    near: Surroundings,
    tables: RoundTables,
    size_of: Ints,
    response: ResponseColumns,
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
    """Add the pressures of the round loads, (n_tactels,) Pa, and mark the patches written to."""
    last = tables.k.shape[2] - 1
    reach = last * STEP
    n_waves = response.waves.shape[1]
    for j in range(n_loads):
        k, s, a, force, indenter = load_link[j], load_s[j], load_a[j], load_force[j], load_indenter[j]
        row, share = row_of(tables, indenter, load_radius[j])
        if row < 0:
            continue
        link = link_at(near, k)
        r = radius_at(near, k, s)
        for p in range(len(near.patch_link)):
            if not is_reached(near, p, k, s, a, 1.2 * reach):  # widths may differ by as much
                continue
            touched[p] = True
            for i in range(near.patch_start[p], near.patch_start[p + 1]):
                x, y = displacement(near.tactel_s[i], near.tactel_a[i], near.tactel_r[i], s, a, r, link)
                S = response.shape[i]
                u, v = S[0, 0] * x + S[0, 1] * y, S[1, 0] * x + S[1, 1] * y
                at = np.sqrt(u * u + v * v) / STEP
                value = 0.0
                if at < last:
                    value = looked_up(tables, row, share, size_of[i], at)
                    value *= S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
                d = np.sqrt(x * x + y * y)
                if n_waves > 0 and d < response.residual[0, -1]:
                    wave = 0.0
                    for q in range(n_waves):
                        wave += np.cos(
                            response.waves[i, q, 0] * x
                            + response.waves[i, q, 1] * y
                            + response.waves[i, q, 2]
                        )
                    rho = np.interp(d, response.residual[0], response.residual[1])
                    value += tables.k[row, size_of[i], 0] * rho * wave * np.sqrt(2.0 / n_waves)
                pressures[i] += force * response.gain[i] * value
