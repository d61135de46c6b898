"""Tables of the pressures under round indenters on an elastic layer, and how they are looked up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from skinbus.jit import inner_kernel
from skinbus.sim.bonded_layer import REACH, table
from skinbus.sim.indenter import Indenter, Shape
from skinbus.sim.layer import Ints

Floats = npt.NDArray[np.float64]

CUT: Final = 1e-4  # of the peak: about one count of 16 bits under 10 N


class RoundTables(NamedTuple):
    """Tables of the round indenters: rows of tables, and which rows belong to an indenter."""

    k: Floats
    """(n_rows, n_diameters, n) 1/m^2 at distances of STEP"""
    first: Ints
    """(n_indenters,) first row; -1: the indenter is not round"""
    growth: Floats
    """(n_indenters,) m, of the contact radius from one row to the next; 0: there is one row"""


def round_tables(
    indenters: Sequence[Indenter],
    diameters: Floats,
    layer: dict[str, float],
    solve: Callable[..., Floats] = table,
) -> RoundTables:
    """Return the tables of the round indenters for tactels of these diameters (m), cut where they are nil."""
    first: list[int] = []
    growth: list[float] = []
    rows: list[list[Floats]] = []
    widest = max((0.5 * i.length for i in indenters if i.shape.is_round), default=0.0)
    reach = REACH * layer["thickness"] + 0.5 * float(diameters.max()) + widest
    for indenter in indenters:
        radii = indenter.radii() if indenter.shape.is_round else np.zeros(0)
        first.append(len(rows) if len(radii) else -1)
        growth.append(radii[1] if len(radii) > 1 else 0.0)
        spread = Indenter(indenter.shape) if indenter.shape is Shape.SPHERE else Indenter()
        rows += [
            [
                solve(
                    **layer,
                    tactel_radius=0.5 * float(diameter),
                    indenter_radius=float(radius),
                    indenter=spread,
                    reach=reach,
                )
                for diameter in diameters
            ]
            for radius in radii
        ]
    k = np.array(rows) if rows else np.zeros((1, len(diameters), 2))
    # beyond the last distance at which any table is worth a count, there is no work
    peaks = np.abs(k).max(axis=-1, keepdims=True)
    worth = np.flatnonzero((np.abs(k) > CUT * peaks).any(axis=(0, 1)))
    k = np.ascontiguousarray(k[..., : (worth[-1] if len(worth) else 0) + 2])
    return RoundTables(k, np.array(first, np.int32), np.array(growth))


@inner_kernel
def row_of(tables: RoundTables, indenter: int, radius: float) -> tuple[int, float]:
    """Return the row of an indenter whose contact has a radius (m), and the share of the row after it.

    A row of -1: the indenter is not round.
    """
    row = tables.first[indenter]
    if row < 0 or not tables.growth[indenter] > 0.0:
        return row, 0.0
    grown = radius / tables.growth[indenter]
    return row + int(grown), grown - int(grown)


@inner_kernel
def looked_up(tables: RoundTables, row: int, share: float, size: int, at: float) -> Any:
    """Return k for a size of tactel at a distance of ``at`` steps, before the end of the tables."""
    cell = int(at)
    table = tables.k[row, size]
    value = table[cell] + (at - cell) * (table[cell + 1] - table[cell])
    if share > 0.0:
        table = tables.k[row + 1, size]
        more = table[cell] + (at - cell) * (table[cell + 1] - table[cell])
        value += share * (more - value)
    return value
